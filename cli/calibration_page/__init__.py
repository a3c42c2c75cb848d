"""``surveilnav cameras calibrate`` as a page in the browser: points are clicked in the camera's picture and on the floor plan.

session      one camera's calibration: its points, picture and plan, and what is written
solution     a pose as the page shows it
app          the addresses of the page, and who may ask for them
serve        the web server, and the browser that is opened
static/      the page, in ES modules; its colours, buttons and theme are those of the gateway's page
"""
