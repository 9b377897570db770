// The scene in three dimensions on a 2D canvas: lit faces, by WebGL; where there is none, sorted by depth and without meshes.

const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const norm = a => Math.hypot(...a);
const unit = a => { const n = norm(a); return n > 0 ? a.map(x => x / n) : [0, 0, 1]; };
const mix = (a, b, s) => a.map((x, i) => x + s * (b[i] - x));
const rgb = hex => [1, 3, 5].map(i => parseInt(hex.slice(i, i + 2), 16));
const LIGHT = unit([0.4, -0.5, 0.9]);
const lit = normal => 0.56 + 0.44 * dot(normal, LIGHT);
class Painter {
  // The ball that is seen at first.
  constructor(canvas, [centre, size]) {
    this.canvas = canvas;
    this.size = size;
    this.pen = canvas.getContext("2d");
    this.home = { turn: -0.9, rise: 0.42, reach: 2.75 * size, target: centre };
    this.lookAt(centre, size);
    this.camera = { ...this.home };
    this.near = 0.02 * size;
    this.polygons = [];
    this.meshes = [];
    this.words = [];
    const sheet = document.createElement("canvas"), gl = sheet.getContext("webgl", { antialias: true });
    this.hardware = gl && new Hardware(gl, sheet);
    // A browser takes WebGL's memory from pages in the background and gives it back later, empty.
    sheet.addEventListener("webglcontextlost", e => e.preventDefault());
    sheet.addEventListener("webglcontextrestored", () => { this.hardware = new Hardware(gl, sheet); this.changed(); });
    this.listen();
  }

  // A smaller ball, which a double click shows.
  lookAt(spot, extent) {
    this.close = { turn: -0.9, rise: 0.6, reach: Math.max(3 * extent, 0.2 * this.size), target: spot };
  }

  // Begin a picture: the camera's axes, and a canvas as fine as the screen.
  begin(background) {
    const { canvas, camera } = this, fine = window.devicePixelRatio || 1;
    this.width = canvas.clientWidth;
    this.height = canvas.clientHeight;
    const w = Math.round(this.width * fine), h = Math.round(this.height * fine);
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
    this.pen.setTransform(fine, 0, 0, fine, 0, 0);
    this.pen.fillStyle = background;
    this.pen.fillRect(0, 0, this.width, this.height);
    const c = Math.cos(camera.rise);
    this.back = [c * Math.cos(camera.turn), c * Math.sin(camera.turn), Math.sin(camera.rise)];
    this.right = [-Math.sin(camera.turn), Math.cos(camera.turn), 0];
    this.up = cross(this.back, this.right);
    this.eye = add(camera.target, this.back, camera.reach);
    this.focal = 1.25 * Math.min(this.width, this.height);
    this.polygons = [];
    this.meshes = [];
    this.words = [];
  }

  // [x, y, depth] on the screen; null behind the camera.
  project(p) {
    const r = add(p, this.eye, -1), depth = -dot(r, this.back);
    if (depth < this.near) return null;
    const s = this.focal / depth;
    return [this.width / 2 + s * dot(r, this.right), this.height / 2 - s * dot(r, this.up), depth];
  }

  // Add a polygon that is projected: how light it is, and how much farther than it is it counts.
  polygon(seen, colour, light, alpha = 1, farther = 0) {
    this.polygons.push({ seen, colour, light, alpha, farther });
  }

  // Add a face: points in space, a colour [r, g, b], lit by its normal unless that is null; farther draws it behind
  // what lies on it.
  face(points, colour, normal = null, alpha = 1, farther = 0) {
    const seen = points.map(p => this.project(p));
    if (!seen.includes(null)) this.polygon(seen, colour, normal ? lit(normal) : 1, alpha, farther);
  }

  // A line through points, as flat pieces; nearer draws it in front of what it lies on.
  line(points, colour, width, alpha = 1, nearer = 0) {
    const seen = points.map(p => this.project(p));
    for (let i = 1; i < seen.length; i++) {
      const a = seen[i - 1], b = seen[i];
      if (!a || !b) continue;
      const long = Math.hypot(b[0] - a[0], b[1] - a[1]) || 1, s = width / 2 / long;
      const [x, y] = [s * (b[0] - a[0]), s * (b[1] - a[1])], end = 0.4 * (alpha === 1);
      const corner = (p, along, across) => [p[0] + along * x - across * y, p[1] + along * y + across * x, p[2]];
      const four = [corner(a, -end, 1), corner(a, -end, -1), corner(b, end, -1), corner(b, end, 1)];
      this.polygon(four, colour, 1, alpha, -nearer);
    }
  }

  // Add a part of many triangles, moved by a 3x4 matrix; only WebGL draws it.
  mesh(part, T) { this.meshes.push([part, T]); }

  // Words beside a point, on its side away from another point.
  text(words, at, ink, other = null) {
    const p = this.project(at), q = other && this.project(other);
    if (p) this.words.push(pen => {
      pen.font = "600 13px system-ui, sans-serif"; pen.fillStyle = ink;
      const wide = pen.measureText(words).width, beside = q && q[0] > p[0] ? p[0] - 14 - wide : p[0] + 14;
      const x = Math.max(4, Math.min(beside, this.width - wide - 4));  // above the tip where it does not fit
      pen.fillText(words, x, p[1] + (x === beside ? 4 : -14));
    });
  }

  // A round bar from a to b that may taper; closed at both ends, in pieces so that depth sorts well.
  bar(a, b, ra, rb, colour, pieces = 1, cap = colour) {
    const along = add(b, a, -1);
    if (norm(along) === 0) return;
    const w = unit(along), u = unit(cross(w, Math.abs(w[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0])), v = cross(w, u);
    const sides = 14, round = [];
    for (let i = 0; i < sides; i++) {
      const t = 2 * Math.PI * i / sides;
      round.push(add(u.map(x => x * Math.cos(t)), v, Math.sin(t)));
    }
    const ring = s => { const c = mix(a, b, s), r = ra + s * (rb - ra); return round.map(d => add(c, d, r)); };
    for (let k = 0; k < pieces; k++) {
      const low = ring(k / pieces), high = ring((k + 1) / pieces);
      for (let i = 0; i < sides; i++) {
        const j = (i + 1) % sides, n = unit(add(round[i], round[j]));
        if (dot(n, add(this.eye, low[i], -1)) > 0) this.face([low[i], low[j], high[j], high[i]], colour, n);
      }
    }
    for (const [s, n] of [[0, w.map(x => -x)], [1, w]]) {
      const rim = ring(s);
      if (dot(n, add(this.eye, rim[0], -1)) > 0) this.face(rim, cap, n);
    }
  }

  // Grid lines on the floor, under everything else.
  floor(height, ink) {
    const { pen, size } = this, step = 10 ** Math.floor(Math.log10(size / 1.5)), n = Math.ceil(1.8 * size / step);
    const [x, y] = this.home.target.map(c => Math.round(c / step) * step);
    pen.strokeStyle = ink;
    pen.lineWidth = 1;
    for (let i = -n; i <= n; i++) {
      for (const [a, b] of [[[x + i * step, y - n * step, height], [x + i * step, y + n * step, height]],
        [[x - n * step, y + i * step, height], [x + n * step, y + i * step, height]]]) {
        for (let k = 0; k < 8; k++) {  // in pieces: what is behind the camera is left out
          const p = this.project(mix(a, b, k / 8)), q = this.project(mix(a, b, (k + 1) / 8));
          if (p && q) { pen.beginPath(); pen.moveTo(p[0], p[1]); pen.lineTo(q[0], q[1]); pen.stroke(); }
        }
      }
    }
  }

  // The shadow of a polyline on the floor, with light from straight above.
  shadow(points, height, width, ink) {
    const seen = points.map(p => this.project([p[0], p[1], height]));
    if (seen.includes(null)) return;
    const { pen } = this;
    pen.beginPath();
    seen.forEach((p, i) => i ? pen.lineTo(p[0], p[1]) : pen.moveTo(p[0], p[1]));
    pen.strokeStyle = ink; pen.lineCap = pen.lineJoin = "round";
    pen.lineWidth = width * this.focal / this.camera.reach;
    pen.stroke();
  }

  end() {
    const far = p => p.seen.reduce((s, c) => s + c[2], 0) / p.seen.length + p.farther;
    const sorted = list => list.map(p => [far(p), p]).sort((a, b) => b[0] - a[0]).map(([, p]) => p);
    if (this.hardware) {
      const solid = this.polygons.filter(p => p.alpha === 1), clear = sorted(this.polygons.filter(p => p.alpha < 1));
      this.hardware.draw(this, solid, clear);
      this.pen.drawImage(this.hardware.sheet, 0, 0, this.width, this.height);
    } else for (const p of sorted(this.polygons)) this.trace(p);
    for (const write of this.words) write(this.pen);
  }

  trace({ seen, colour, light, alpha }) {
    const { pen } = this;
    const ink = `rgba(${colour.map(x => Math.min(255, light * x) | 0)},${alpha})`;
    pen.beginPath();
    seen.forEach((p, i) => i ? pen.lineTo(p[0], p[1]) : pen.moveTo(p[0], p[1]));
    pen.closePath();
    pen.fillStyle = ink;
    pen.fill();
    if (alpha === 1) { pen.strokeStyle = ink; pen.lineWidth = 0.7; pen.stroke(); }  // no seams between faces
  }

  listen() {
    const { canvas } = this, held = new Map();
    const moved = (dx, dy, pan) => {
      const c = this.camera;
      if (!pan) { c.turn -= 0.008 * dx; c.rise = Math.min(1.55, Math.max(-1.55, c.rise + 0.008 * dy)); return; }
      const s = c.reach / this.focal;
      c.target = add(add(c.target, this.right, -s * dx), this.up, s * dy);
    };
    const zoom = s => {
      this.camera.reach = Math.min(20 * this.size, Math.max(0.2 * this.size, this.camera.reach * s));
    };
    canvas.addEventListener("pointerdown", e => { canvas.setPointerCapture(e.pointerId); held.set(e.pointerId, e); });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, e => held.delete(e.pointerId));
    canvas.addEventListener("pointermove", e => {
      const last = held.get(e.pointerId);
      if (!last) return;
      if (held.size === 2) {  // two fingers: zoom
        const other = [...held.values()].find(o => o.pointerId !== e.pointerId);
        const apart = p => Math.hypot(p.clientX - other.clientX, p.clientY - other.clientY);
        if (apart(e) > 0) zoom(apart(last) / apart(e));
      } else moved(e.clientX - last.clientX, e.clientY - last.clientY, e.shiftKey || e.buttons > 1);
      held.set(e.pointerId, e);
      this.changed();
    });
    canvas.addEventListener("wheel", e => { e.preventDefault(); zoom(Math.exp(0.001 * e.deltaY)); this.changed(); },
      { passive: false });
    canvas.addEventListener("dblclick", () => {
      this.nearby = !this.nearby;
      this.camera = { ...(this.nearby ? this.close : this.home) };
      this.changed();
    });
    canvas.addEventListener("contextmenu", e => e.preventDefault());
  }

  changed() {}
}
