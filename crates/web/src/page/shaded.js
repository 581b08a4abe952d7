// Draws the surface by WebGL: shaded by the direction of view, in the colours of a ramp. Seen from behind it is left out,
// so that one looks through a ceiling into the room.
import { joined } from './surface.js';

const VERTEX = `
attribute vec3 place; attribute vec3 normal; attribute float born;
uniform mat4 view; uniform mat4 pose; uniform vec3 up; uniform vec3 into; uniform vec2 range; uniform float by;
uniform vec3 low; uniform vec3 middle; uniform vec3 high; varying vec3 tone;
void main() {
  vec4 p = pose * vec4(place, 1.0); vec3 n = normalize((pose * vec4(normal, 0.0)).xyz + vec3(1e-12));
  float value = by < 0.5 ? dot(up, p.xyz) : by < 1.5 ? born : dot(up, n);
  float s = clamp((value - range.x) / max(range.y - range.x, 1e-6), 0.0, 1.0);
  vec3 c = s < 0.5 ? mix(low, middle, 2.0 * s) : mix(middle, high, 2.0 * s - 1.0);
  gl_Position = view * p; tone = c * (0.4 + 0.6 * abs(dot(n, into)));
}`;
const FRAGMENT = 'precision mediump float; varying vec3 tone; void main() { gl_FragColor = vec4(tone, 1.0); }';
const BY = { height: 0, age: 1, normal: 2 };
const ATTRIBUTES = [['place', 3], ['normal', 3], ['born', 1]];
const STRIDE = 28;

export class Shaded {
  // On a scene; `isPossible` is false where its WebGL lacks corners of 32 bits.
  constructor(scene) {
    this.scene = scene;
    this.begin();
    scene.canvas.addEventListener('webglcontextrestored', () => this.begin());
  }

  begin() {
    const { gl } = this.scene;
    this.isPossible = gl.getExtension('OES_element_index_uint') !== null;
    this.program = this.scene.program([VERTEX, FRAGMENT]);
    // Buffers by the mesh of a cube: those of a context before this one are gone.
    this.buffers = new Map();
  }

  // `by` is what the colours tell, `range` its values at the ends of the ramp `colours`; `into` is where one looks.
  draw(surface, { by, range, up, into, colours }) {
    const { gl, view } = this.scene;
    const { program } = this;
    const at = (name) => gl.getUniformLocation(program, name);
    const places = ATTRIBUTES.map(([name]) => gl.getAttribLocation(program, name));
    gl.useProgram(program);
    gl.uniformMatrix4fv(at('view'), false, view);
    gl.uniform3fv(at('up'), up);
    gl.uniform3fv(at('into'), into);
    gl.uniform2fv(at('range'), range);
    gl.uniform1f(at('by'), BY[by]);
    ['low', 'middle', 'high'].forEach((name, i) => gl.uniform3fv(at(name), colours[i]));
    gl.enable(gl.CULL_FACE);
    for (let k = 0; k < 4; k += 1) gl.disableVertexAttribArray(k);
    places.forEach((place) => gl.enableVertexAttribArray(place));
    const unused = new Set(this.buffers.keys());
    for (const { pose, cubes } of surface.parts.values()) {
      gl.uniformMatrix4fv(at('pose'), false, pose);
      for (const cube of cubes.values()) {
        if (cube.blocks.size === 0) continue;
        cube.mesh ??= {};
        const { vertices, corners, count } = this.buffers.get(cube.mesh) ?? this.upload(cube);
        unused.delete(cube.mesh);
        gl.bindBuffer(gl.ARRAY_BUFFER, vertices);
        gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, corners);
        let offset = 0;
        ATTRIBUTES.forEach(([, n], i) => {
          gl.vertexAttribPointer(places[i], n, gl.FLOAT, false, STRIDE, offset);
          offset += 4 * n;
        });
        gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_INT, 0);
      }
    }
    gl.disable(gl.CULL_FACE);
    for (const mesh of unused) {
      const { vertices, corners } = this.buffers.get(mesh);
      [vertices, corners].forEach((buffer) => gl.deleteBuffer(buffer));
      this.buffers.delete(mesh);
    }
  }

  upload(cube) {
    const { gl } = this.scene;
    const { vertices, corners } = joined(cube);
    const filled = (kind, data) => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(kind, buffer);
      gl.bufferData(kind, data, gl.STATIC_DRAW);
      return buffer;
    };
    const held = { vertices: filled(gl.ARRAY_BUFFER, vertices), corners: filled(gl.ELEMENT_ARRAY_BUFFER, corners), count: corners.length };
    this.buffers.set(cube.mesh, held);
    return held;
  }
}
