// Play, pause and seek; each moment draws the scene, the cursors of the curves and the bars of the joints.

const $ = id => document.getElementById(id);
const decoded = (a, kind = Float32Array) => {
  const bytes = Uint8Array.from(atob(a.data), c => c.charCodeAt(0));
  return { shape: a.shape, data: new kind(bytes.buffer) };
};
const run = JSON.parse($("run").textContent);
const arrays = Object.fromEntries(Object.entries(run.arrays).map(([name, a]) => [name, decoded(a)]));
const { time: { data: time } } = arrays, frames = time.length, { duration: last, limit_active: limited } = run;

// The numbers of an array in one frame, and interpolated between two frames.
const row = (name, i) => {
  const { shape, data } = arrays[name], n = shape.slice(1).reduce((a, b) => a * b, 1);
  return Array.from(data.subarray(i * n, (i + 1) * n));
};
const between = (name, f) => {
  const i = Math.min(Math.floor(f), frames - 2);
  return mix(row(name, i), row(name, i + 1), f - i);
};
const triples = flat => Array.from({ length: flat.length / 3 }, (_, i) => flat.slice(3 * i, 3 * i + 3));
const originOf = T => [T[3], T[7], T[11]];
const frameAt = t => {
  let low = 0, high = frames - 1;
  while (high - low > 1) { const mid = (low + high) >> 1; if (time[mid] <= t) low = mid; else high = mid; }
  return low + (t - time[low]) / (time[high] - time[low]);
};

const state = { t: 0, playing: false, rate: 1 };
const fixed = name => arrays[name].data;
const arm = new Arm(fixed("screws"), run.coordinates, run.drivers, fixed("places"), Array.from(fixed("home")));
// Where the arm is in a frame, whole or between two; of recorded poses alone the tool is all there is.
const armAt = f => {
  if (run.joints.length) return arm.at(between("q", f));
  const tool = between("wanted", f);
  return { motions: [], points: [originOf(tool)], axes: [], tool };
};
const r = run.size, painter = new Painter($("view"), [run.centre, r]);
const parts = (painter.hardware ? run.parts : []).map(part => {
  const vertices = decoded(part.vertices).data, faces = decoded(part.faces, Uint16Array).data;
  return { ...part, vertices, faces, normals: smooth(vertices, faces) };
});
const floor = run.floor - 0.01 * r;
const bars = new Bars($("joints"), { ...run, limits: fixed("limits"), speedLimit: fixed("speed_limit") });
if (!run.joints.length) $("joints").previousElementSibling.hidden = $("joints").hidden = true;
const path = triples([...fixed("path")]), faces = triples([...fixed("faces")]);
const drawn = Array.from({ length: frames }, (_, i) => originOf(armAt(i).tool));
const solids = run.solids.map(({ joint, faces, poses }) => ({
  joint, faces: triples([...decoded(faces).data]), poses: poses && decoded(poses).data }));
const charts = run.charts.map(c => {
  c.values = decoded(c.values);
  return new Chart($("side"), c, { time, limited, last }, t => { play(false); seek(t); });
});
const caption = $("side").appendChild(document.createElement("p"));
caption.textContent = limited.some(Boolean) ? "time [s]; shaded where a limit is active" : "time [s]";
$("time").max = last;

const HUES = { ...Object.fromEntries(Object.entries(run.hues).map(([name, hue]) => [name, rgb(hue)])),
  dark: rgb("#4a5764"), touched: rgb("#cdbb9f") };
const keyed = (hue, words) => `<span><i style="color:${run.hues[hue]}"></i>${words}</span> `;
function key() {
  $("key").innerHTML = (run.recorded ? "" : keyed("wanted", "desired path"))
    + keyed("drawn", run.recorded ? "recorded path" : "actual path")
    + (arrays.force ? keyed("force", "force of the tool") : "") + keyed("travel", "velocity of the tool")
    + (solids.length ? keyed("body", "bodies kept apart") : "")
    + (matchMedia("(pointer: coarse)").matches ? "<br>drag: turn, two fingers: zoom"
      : "<br>drag: turn, shift-drag: move, wheel: zoom, double click: near and far");
  if (run.missing) $("key").append(document.createElement("br"), run.missing);
}

function triad(T, length, width, alpha, names) {
  const at = originOf(T);
  ["#D62F2F", "#2E9E3F", "#2F62D6"].forEach((hue, i) => {
    const tip = add(at, [T[i], T[4 + i], T[8 + i]], length);
    painter.line([at, tip], rgb(hue), width, alpha, 0.03 * r);
    if (names) painter.text("xyz"[i], tip, hue);
  });
}

// An arrow by the scale of its kind, with its size and unit at the tip; none for what is less than `least`.
function arrow(at, way, [least, most], hue, words) {
  const size = norm(way), share = Math.max(0.1, size / most);
  if (size < least) return;
  const tip = add(at, unit(way), 0.35 * r * share), neck = add(tip, unit(way), -Math.min(0.06, 0.2 * share) * r);
  painter.bar(at, neck, 0.01 * r, 0.01 * r, hue);
  painter.bar(neck, tip, 0.028 * r, 0.001 * r, hue);
  painter.text(words, tip, `rgb(${hue})`, at);
}

// Links as bars from joint to joint, where an arm is not drawn by its meshes.
function drawLinks(points) {
  const link = rgb(ink("--link")), n = points.length, taper = k => 0.03 * r * (1 - 0.45 * k / (n - 1));
  painter.bar(add(points[0], [0, 0, -0.004 * r]), add(points[0], [0, 0, 0.012 * r]), 0.09 * r, 0.09 * r, HUES.dark);
  points.slice(1).forEach((p, k) => {
    const pieces = Math.max(1, Math.round(norm(add(p, points[k], -1)) / (0.1 * r)));
    painter.bar(points[k], p, taper(k), taper(k + 1), link, pieces);
  });
}

// A joint: a drum along its axis; a slide is a sleeve, long and thin. On meshes, a rod along the axis, seen through them.
function joint(p, u, k) {
  const hue = rgb(run.colours[k]), slide = run.slides[k], half = (slide ? 0.075 : 0.052) * r, a = add(p, u, -half);
  if (parts.length) painter.line([a, add(p, u, half)], hue, 4, 1, 0.3 * r);
  else if (slide) painter.bar(a, add(p, u, half), 0.036 * r, 0.036 * r, hue, 2, HUES.dark);
  else painter.bar(a, add(p, u, half), 0.045 * r, 0.045 * r, HUES.dark, 1, hue);
}

function draw() {
  const f = frameAt(state.t), i = Math.round(f);
  painter.begin(ink("--well"));
  const { motions, points, axes, tool } = armAt(f), goal = between("wanted", f);
  painter.floor(floor, ink("--rule"));
  painter.shadow(points, floor, 0.05 * r, "rgba(0,0,0,0.10)");
  for (let k = 0; k < faces.length; k += 4) {
    const [a, b, c, d] = faces.slice(k, k + 4);
    painter.face([a, b, c, d], HUES.touched, unit(cross(add(b, a, -1), add(d, a, -1))), 0.5, 0.06 * r);
  }
  for (const { joint, faces, poses } of solids) {  // obstacles, and the arm's bodies seen through
    const last = poses ? poses.length / 12 - 1 : 0, k = 12 * Math.min(i, last);
    const T = poses ? Array.from(poses.slice(k, k + 12)) : motions[joint];
    for (let k = 0; k < faces.length; k += 4) {
      const [a, b, c, d] = faces.slice(k, k + 4).map(p => act(T, p));
      const normal = unit(cross(add(c, a, -1), add(d, b, -1)));
      painter.face([a, b, c, d], poses ? HUES.touched : HUES.body, normal, poses ? 0.5 : 0.16, poses ? 0.02 * r : 0);
    }
  }
  if (run.axis) {  // a door, from its axis to the tool
    const [a, b] = run.axis, out = add(originOf(tool), a, -1), along = unit(add(b, a, -1));
    const arm = add(out, along, -dot(out, along));
    for (let k = 0; k < 8; k++) {
      const c = add(a, arm, k / 8), d = add(a, arm, (k + 1) / 8);
      painter.face([c, d, add(d, add(b, a, -1)), add(c, add(b, a, -1))], HUES.touched, null, 0.5);
    }
    painter.bar(a, b, 0.012 * r, 0.012 * r, HUES.dark, 4);
  }
  if (!run.recorded) painter.line(path, HUES.wanted, 5, 1, 0.01 * r);
  painter.line([...drawn.slice(0, Math.floor(f) + 1), originOf(tool)], HUES.drawn, 2, 1, 0.02 * r);
  if (parts.length) for (const part of parts) painter.mesh(part, motions[part.joint]);
  else if (points.length > 1) drawLinks(points);
  axes.forEach((u, k) => joint(points[k + 1], u, k));
  if (!run.recorded) triad(goal, 0.13 * r, 2, 0.35, false);
  triad(tool, 0.13 * r, 3.5, 1, true);
  const lines = [`t      ${state.t.toFixed(2)} s`], error = run.charts.find(c => c.title === run.error_title);
  if (run.recorded) lines.push(`contact ${run.status[i]}`);
  else if (error) {
    const { data } = error.values;
    lines.push(`error  ${written(data[i])} mm, ${written(data[frames + i])} deg`);
  }
  if (!run.recorded) lines.push(`status ${run.status[i]}`);
  if (limited[i]) lines.push("limit active");
  if (arrays.force) {
    const push = between("force", f), size = norm(push), at = originOf(tool);
    lines.push(`force  ${size.toFixed(2)} N`);
    arrow(at, push, run.force_scale, HUES.force, `${size.toFixed(1)} N`);
  }
  const going = between("travel", f), pace = `${written(1000 * norm(going))} mm/s`;
  lines.push(`speed  ${pace}`);
  arrow(originOf(tool), going, run.travel_scale, HUES.travel, pace);
  painter.end();
  $("status").replaceChildren(...lines.map(words => {
    const line = document.createElement("span");
    line.className = /^limit|^status (?!ok)/.test(words) ? "bad" : "";
    line.textContent = `${words}\n`;
    return line;
  }));
  for (const chart of charts) chart.draw(state.t);
  if (run.joints.length) bars.draw(between("q", f), row("speed", i));
  $("time").value = state.t;
  $("clock").textContent = `${state.t.toFixed(2)} / ${last.toFixed(2)} s`;
}

function seek(t) { state.t = Math.min(last, Math.max(0, t)); draw(); }

let before = null;
function tick(now) {
  if (!state.playing) { before = null; return; }
  if (before !== null) seek(state.t + state.rate * (now - before) / 1000);
  before = now;
  if (state.t >= last) play(false);
  else requestAnimationFrame(tick);
}

function play(on) {
  const start = on && !state.playing;
  state.playing = on;
  $("play").textContent = on ? "Pause" : "Play";
  if (!start) return;
  if (state.t >= last) seek(0);
  before = null;
  requestAnimationFrame(tick);
}

function setRate() {
  state.rate = 2 ** $("speed").value;
  $("rate").textContent = `${+state.rate.toPrecision(3)} x`;
}

function layout() { for (const chart of charts) chart.layout(); draw(); }

painter.changed = () => { if (!state.playing) draw(); };
$("time").addEventListener("input", e => { play(false); seek(+e.target.value); });
$("speed").addEventListener("input", setRate);
$("play").addEventListener("click", () => play(!state.playing));
addEventListener("keydown", e => {
  const step = { ArrowLeft: -1, ArrowRight: 1 }[e.key];
  if (e.key === " " && e.target !== $("play")) { e.preventDefault(); play(!state.playing); }
  if (step && e.target.type !== "range") { play(false); seek(time[Math.round(frameAt(state.t)) + step] ?? state.t); }
});
addEventListener("resize", layout);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", layout);
const ends = [Math.min, Math.max].map(pick => [0, 1, 2].map(i => drawn.reduce((a, p) => pick(a, p[i]), drawn[0][i])));
painter.lookAt(mix(...ends, 0.5), norm(add(...ends, -1)) / 2);
key();
setRate();
layout();
// page.html#2.5 opens at 2.5 s and does not play; without a number the page plays.
const moment = location.hash.length > 1 ? Number(location.hash.slice(1)) : NaN;
if (Number.isFinite(moment)) seek(moment); else play(true);
