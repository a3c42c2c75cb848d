// Points on the graphics card: one buffer, which a newer cloud takes the place of.

const VERTEX = `#version 300 es
  layout(location=0) in vec3 p; layout(location=1) in vec3 rgb;
  uniform mat4 m; uniform float px, cut; out vec3 ink;
  void main() {
    gl_Position = p.z > cut ? vec4(2.0, 2.0, 2.0, 1.0) : m * vec4(p, 1.0);
    gl_PointSize = clamp(px / gl_Position.w, 1.5, 14.0);
    ink = rgb;
  }`;
const FRAGMENT = `#version 300 es
  precision mediump float; in vec3 ink; out vec4 colour;
  void main() { vec2 c = gl_PointCoord - 0.5; if (dot(c, c) > 0.25) discard; colour = vec4(ink, 1.0); }`;
/** A point's size [m]. */
const SIZE_M = 0.07;

export class Points {
  constructor(canvas) {
    this.gl = canvas.getContext("webgl2", { antialias: true, alpha: true });
    if (!this.gl) throw new Error("This browser draws nothing in 3D (WebGL 2 is off).");
    this.program = linked(this.gl);
    this.at = Object.fromEntries(["m", "px", "cut"].map(name => [name, this.gl.getUniformLocation(this.program, name)]));
    this.buffer = this.gl.createBuffer();
    this.count = 0;
  }

  /** Takes (N, 6): x, y, z, red, green, blue. */
  set(values) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    this.count = values.length / 6;
  }

  draw(matrix, width, height, cut) {
    const { gl, at } = this;
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(this.program);
    gl.uniformMatrix4fv(at.m, false, matrix);
    gl.uniform1f(at.px, SIZE_M * height);
    gl.uniform1f(at.cut, cut);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    for (const [k, offset] of [[0, 0], [1, 12]]) { gl.enableVertexAttribArray(k); gl.vertexAttribPointer(k, 3, gl.FLOAT, false, 24, offset); }
    gl.drawArrays(gl.POINTS, 0, this.count);
  }

  /** Gives back what it holds. */
  end() { this.gl.getExtension("WEBGL_lose_context")?.loseContext(); }
}

function linked(gl) {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(`The 3D view can't be drawn: ${gl.getProgramInfoLog(program)}`);
  return program;
}
