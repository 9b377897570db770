// A picture by WebGL.

// What moves little is projected here and sent anew in each picture: corners [x, y, depth] and colours with alpha. Meshes
// are sent once, as corners with normals, and WebGL moves and projects them.
const FLAT = { numbers: 7, parts: { at: [3, 0], ink: [4, 3] }, vertex: `
  attribute vec3 at; attribute vec4 ink; varying lowp vec4 paint;
  void main() { gl_Position = vec4(at, 1.0); paint = vec4(ink.rgb * ink.a, ink.a); }` };
const SOLID = { numbers: 6, parts: { at: [3, 0], normal: [3, 3] }, vertex: `
  attribute vec3 at, normal; varying lowp vec4 paint; uniform mat4 view; uniform vec3 light, hue;
  void main() { gl_Position = view * vec4(at, 1.0); paint = vec4(hue * (0.56 + 0.44 * dot(normal, light)), 1.0); }` };
const FRAGMENT = "varying lowp vec4 paint; void main() { gl_FragColor = paint; }";

class Hardware {
  constructor(gl, sheet) {
    Object.assign(this, { gl, sheet });
    this.flat = this.program(FLAT);
    this.solid = this.program(SOLID);
    this.buffer = gl.createBuffer();
    this.parts = new Map();
    this.numbers = new Float32Array(1 << 16);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  program({ vertex }) {
    const { gl } = this, program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    return program;
  }

  // Draw by a program the triangles of a buffer.
  triangles(program, { numbers, parts }, buffer, count) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    for (const [name, [size, from]] of Object.entries(parts)) {
      const place = gl.getAttribLocation(program, name);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, size, gl.FLOAT, false, 4 * numbers, 4 * from);
    }
    gl.drawArrays(gl.TRIANGLES, 0, count);
  }

  // The triangles of a part, in WebGL's memory: each corner and the normal there.
  stored(part) {
    const { gl } = this, { vertices, faces, normals } = part;
    if (this.parts.has(part)) return this.parts.get(part);
    const numbers = new Float32Array(SOLID.numbers * faces.length);
    faces.forEach((corner, i) => {
      numbers.set(vertices.subarray(3 * corner, 3 * corner + 3), SOLID.numbers * i);
      numbers.set(normals.subarray(3 * i, 3 * i + 3), SOLID.numbers * i + 3);
    });
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, numbers, gl.STATIC_DRAW);
    this.parts.set(part, buffer);
    return buffer;
  }

  // The 4x4 matrix, by columns, from the points of a part at q = 0 to the screen, as `project` and `corners` have it.
  view(camera, T) {
    const { near, focal, width, height } = camera, from = add([T[3], T[7], T[11]], camera.eye, -1);
    const row = (axis, s) => [...back(T, axis), dot(axis, from)].map(x => s * x);
    const depth = row(camera.back, -1), z = depth.map((x, i) => x - (i === 3 ? 2 * near : 0));
    const rows = [row(camera.right, 2 * focal / width), row(camera.up, 2 * focal / height), z, depth];
    return [0, 1, 2, 3].flatMap(i => rows.map(r => r[i]));
  }

  // Draw what a painter has collected: what is solid hides what is behind it, what is clear is laid over it.
  draw(painter, solid, clear) {
    const { gl, sheet } = this, { canvas } = painter;
    if (sheet.width !== canvas.width || sheet.height !== canvas.height) {
      sheet.width = canvas.width; sheet.height = canvas.height;
    }
    gl.viewport(0, 0, sheet.width, sheet.height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(this.solid);
    for (const [part, T] of painter.meshes) {
      gl.uniformMatrix4fv(gl.getUniformLocation(this.solid, "view"), false, this.view(painter, T));
      gl.uniform3fv(gl.getUniformLocation(this.solid, "light"), back(T, LIGHT));
      gl.uniform3fv(gl.getUniformLocation(this.solid, "hue"), part.colour.map(x => x / 255));
      this.triangles(this.solid, SOLID, this.stored(part), part.faces.length);
    }
    gl.useProgram(this.flat);
    for (const [list, solids] of [[solid, true], [clear, false]]) {
      const count = this.corners(painter, list);
      gl.depthMask(solids);
      gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
      gl.bufferData(gl.ARRAY_BUFFER, this.numbers.subarray(0, FLAT.numbers * count), gl.STREAM_DRAW);
      this.triangles(this.flat, FLAT, this.buffer, count);
    }
    gl.depthMask(true);
  }

  // Write the corners of polygons, as triangles, and return how many there are.
  corners({ width, height, near }, polygons) {
    const count = polygons.reduce((n, p) => n + 3 * (p.seen.length - 2), 0);
    if (FLAT.numbers * count > this.numbers.length) this.numbers = new Float32Array(2 * FLAT.numbers * count);
    const { numbers } = this;
    let at = 0;
    for (const { seen, colour, light, alpha, farther } of polygons) {
      for (let k = 2; k < seen.length; k++) {
        for (const i of [0, k - 1, k]) {
          const [x, y, depth] = seen[i];
          numbers[at++] = 2 * x / width - 1;
          numbers[at++] = 1 - 2 * y / height;
          numbers[at++] = 1 - 2 * near / Math.max(near, depth + farther);
          for (let c = 0; c < 3; c++) numbers[at++] = colour[c] * light / 255;
          numbers[at++] = alpha;
        }
      }
    }
    return count;
  }
}
