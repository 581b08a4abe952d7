// The map in three dimensions, by WebGL: points as discs, lines as ribbons of even width, the walker as a small body.
// Positions are those of the map; the view comes as a matrix. A lost context draws again when it is restored.

const POINTS = [`
attribute vec3 place; attribute vec3 colour; uniform mat4 view; uniform float size; varying vec3 tone;
void main() { gl_Position = view * vec4(place, 1.0); gl_PointSize = size; tone = colour; }`, `
precision mediump float; varying vec3 tone; uniform float round;
void main() { vec2 p = gl_PointCoord - 0.5; if (round > 0.5 && dot(p, p) > 0.25) discard; gl_FragColor = vec4(tone, 1.0); }`];
// Each end of a piece is moved aside by half the width, in pixels; what is behind the eye is left out by the clipping.
const RIBBONS = [`
attribute vec3 place; attribute vec3 other; attribute vec2 side; attribute vec3 colour;
uniform mat4 view; uniform vec2 pixels; uniform float width; varying vec3 tone; varying float along;
void main() {
  vec4 a = view * vec4(place, 1.0); vec4 b = view * vec4(other, 1.0);
  vec2 d = (b.xy / max(b.w, 0.001) - a.xy / max(a.w, 0.001)) * pixels * side.x;
  vec2 n = length(d) > 0.0 ? normalize(vec2(-d.y, d.x)) : vec2(0.0);
  a.xy += n * side.y * width / pixels * a.w;
  gl_Position = a; tone = colour; along = side.x > 0.0 ? 0.0 : length(d);
}`, `
precision mediump float; varying vec3 tone; varying float along; uniform float dash;
void main() { if (dash > 0.0 && mod(along, dash) > 0.6 * dash) discard; gl_FragColor = vec4(tone, 1.0); }`];

export class Scene {
  // Null where WebGL is missing.
  static on(canvas) {
    const gl = canvas.getContext('webgl', { antialias: true, alpha: false, preserveDrawingBuffer: true });
    return gl && new Scene(canvas, gl);
  }

  constructor(canvas, gl) {
    Object.assign(this, { canvas, gl });
    this.begin();
    canvas.addEventListener('webglcontextlost', (event) => event.preventDefault());
    canvas.addEventListener('webglcontextrestored', () => this.begin());
  }

  begin() {
    const { gl } = this;
    this.points = this.program(POINTS);
    this.ribbons = this.program(RIBBONS);
    this.buffer = gl.createBuffer();
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
  }

  program([vertex, fragment]) {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(gl.getProgramInfoLog(program));
    return program;
  }

  // Begins a picture: the canvas in device pixels, its ground, and the view as a matrix, column by column.
  clear(ground, view) {
    const { gl, canvas } = this;
    const ratio = Math.min(2, window.devicePixelRatio || 1);
    const [w, h] = [canvas.clientWidth, canvas.clientHeight].map((v) => Math.max(1, Math.round(v * ratio)));
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    this.ratio = ratio;
    this.view = view;
    gl.viewport(0, 0, w, h);
    gl.clearColor(...ground, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }

  // Discs: places and colours, three numbers each.
  discs(places, colours, size) {
    this.shapes(places, colours, size, this.gl.POINTS);
  }

  // Triangles.
  solid(places, colours) {
    this.shapes(places, colours, 1, this.gl.TRIANGLES);
  }

  shapes(places, colours, size, kind) {
    const { gl, points: program } = this;
    const count = places.length / 3;
    if (count === 0) return;
    const data = new Float32Array(6 * count);
    for (let i = 0; i < count; i += 1) {
      for (let k = 0; k < 3; k += 1) [data[6 * i + k], data[6 * i + 3 + k]] = [places[3 * i + k], colours[3 * i + k]];
    }
    this.use(program, data, [['place', 3], ['colour', 3]]);
    gl.uniform1f(gl.getUniformLocation(program, 'size'), size * this.ratio);
    gl.uniform1f(gl.getUniformLocation(program, 'round'), kind === gl.POINTS ? 1 : 0);
    gl.drawArrays(kind, 0, count);
  }

  // Pieces of lines: pairs of places, one colour, width and length of a dash in pixels.
  lines(pairs, colour, width, dash = 0) {
    const { gl, ribbons: program } = this;
    if (pairs.length === 0) return;
    const data = new Float32Array(66 * pairs.length);
    let at = 0;
    // Two triangles; what is left of the direction at one end is right of it at the other.
    for (const [a, b] of pairs) {
      for (const [here, there, along, side] of [[a, b, 1, 1], [a, b, 1, -1], [b, a, -1, 1], [b, a, -1, 1], [a, b, 1, -1], [b, a, -1, -1]]) {
        data.set(here, at);
        data.set(there, at + 3);
        [data[at + 6], data[at + 7]] = [along, side];
        data.set(colour, at + 8);
        at += 11;
      }
    }
    this.use(program, data, [['place', 3], ['other', 3], ['side', 2], ['colour', 3]]);
    gl.uniform2f(gl.getUniformLocation(program, 'pixels'), this.canvas.width, this.canvas.height);
    gl.uniform1f(gl.getUniformLocation(program, 'width'), width * this.ratio);
    gl.uniform1f(gl.getUniformLocation(program, 'dash'), dash * this.ratio);
    gl.drawArrays(gl.TRIANGLES, 0, 6 * pairs.length);
  }

  use(program, data, attributes) {
    const { gl } = this;
    gl.useProgram(program);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STREAM_DRAW);
    const stride = 4 * attributes.reduce((sum, [, n]) => sum + n, 0);
    for (let k = 0; k < 4; k += 1) gl.disableVertexAttribArray(k);
    let offset = 0;
    for (const [name, n] of attributes) {
      const place = gl.getAttribLocation(program, name);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, n, gl.FLOAT, false, stride, offset);
      offset += 4 * n;
    }
    gl.uniformMatrix4fv(gl.getUniformLocation(program, 'view'), false, this.view);
  }
}
