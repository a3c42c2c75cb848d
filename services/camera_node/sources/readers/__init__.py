"""Readers of streams, a file for each kind: RTSP, HTTP (MJPEG or single pictures), USB, a video file, a folder of pictures."""
