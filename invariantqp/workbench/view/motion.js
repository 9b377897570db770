// Where the parts of an arm are: products of exponentials of its joint screws. Rigid motions are 3x4, by rows.

const act = (T, p) => [0, 4, 8].map(i => T[i] * p[0] + T[i + 1] * p[1] + T[i + 2] * p[2] + T[i + 3]);
const rotated = (T, v) => [0, 4, 8].map(i => T[i] * v[0] + T[i + 1] * v[1] + T[i + 2] * v[2]);
const back = (T, v) => [0, 1, 2].map(i => T[i] * v[0] + T[i + 4] * v[1] + T[i + 8] * v[2]);
const STILL = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];

// A motion from where it takes the axes and the origin.
const rigid = (x, y, z, p) => [0, 1, 2].flatMap(i => [x[i], y[i], z[i], p[i]]);
const times = (A, B) => {
  const column = i => rotated(A, [B[i], B[4 + i], B[8 + i]]);
  return rigid(column(0), column(1), column(2), act(A, [B[3], B[7], B[11]]));
};

// exp(q s), s = (w; v), t = |w| q:
//   R = 1 + sin t W + (1 - cos t) W^2,    p = (t + (1 - cos t) W + (t - sin t) W^2) v / |w|
function exp(w, v, q) {
  const rate = norm(w);
  if (rate === 0) return rigid([1, 0, 0], [0, 1, 0], [0, 0, 1], v.map(x => q * x));
  const n = w.map(x => x / rate), t = rate * q, sine = Math.sin(t), rest = 2 * Math.sin(t / 2) ** 2;
  const series = (u, a, b, c) => {
    const once = cross(n, u), twice = cross(n, once);
    return u.map((x, i) => a * x + b * once[i] + c * twice[i]);
  };
  const [x, y, z] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map(e => series(e, 1, sine, rest));
  return rigid(x, y, z, series(v.map(x => x / rate), t, rest, t - sine));
}

// An arm from the screws (6, k) of all its joints, the coordinate (k,) that moves each, which of them (m,) the
// coordinates are named after, places of those (m, 3) and tool pose at q = 0: what is where at joint positions q.
class Arm {
  constructor(screws, coordinates, drivers, places, home) {
    const n = coordinates.length;
    this.screws = Array.from({ length: n }, (_, i) => [0, 1, 2, 3, 4, 5].map(k => screws[k * n + i]));
    Object.assign(this, { coordinates, drivers });
    this.places = triples(places);
    this.home = home.slice(0, 12);
  }

  at(q) {
    const before = [STILL];
    this.screws.forEach((s, i) => before.push(times(before[i], exp(s.slice(0, 3), s.slice(3), q[this.coordinates[i]]))));
    const joints = this.places.map((p, i) => act(before[this.drivers[i]], p));
    const tool = times(before[before.length - 1], this.home);
    const direction = s => norm(s.slice(0, 3)) ? s.slice(0, 3) : s.slice(3);
    const axes = this.drivers.map(i => unit(rotated(before[i], direction(this.screws[i]))));
    return { motions: before, points: [[0, 0, 0], ...joints, originOf(tool)], axes, tool };
  }
}

// Normals at the corners of triangles: the mean of the triangles there that are nearly parallel, so that edges stay edges.
function smooth(vertices, faces) {
  const flat = [], at = new Map(), normals = new Float32Array(3 * faces.length);
  for (let i = 0; i < faces.length; i += 3) {
    const [a, b, c] = [0, 1, 2].map(k => vertices.subarray(3 * faces[i + k], 3 * faces[i + k] + 3));
    flat.push(cross([b[0] - a[0], b[1] - a[1], b[2] - a[2]], [c[0] - a[0], c[1] - a[1], c[2] - a[2]]));
    for (let k = 0; k < 3; k++) at.set(faces[i + k], [...(at.get(faces[i + k]) ?? []), i / 3]);
  }
  const units = flat.map(unit);
  faces.forEach((corner, i) => {
    const own = units[Math.floor(i / 3)];
    const near = at.get(corner).filter(f => dot(units[f], own) > 0.75);
    normals.set(unit(near.reduce((sum, f) => add(sum, flat[f]), [0, 0, 0])), 3 * i);
  });
  return normals;
}
