// Play, pause and seek; each moment draws the scene, the cursors of the curves and the bars of the joints.

const $ = id => document.getElementById(id);
const decoded = a => {
  const bytes = Uint8Array.from(atob(a.data), c => c.charCodeAt(0));
  return { shape: a.shape, data: new Float32Array(bytes.buffer) };
};
const run = JSON.parse($("run").textContent);
const arrays = Object.fromEntries(Object.entries(run.arrays).map(([name, a]) => [name, decoded(a)]));
for (const chart of run.charts) chart.values = decoded(chart.values);
const { data: time } = arrays.time, last = time[time.length - 1], frames = time.length;
const limited = run.limit_active;

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
const spot = T => [T[3], T[7], T[11]];
const path = name => Array.from({ length: frames }, (_, i) => spot(row(name, i)));
const frameAt = t => {
  let low = 0, high = frames - 1;
  while (high - low > 1) { const mid = (low + high) >> 1; if (time[mid] <= t) low = mid; else high = mid; }
  return low + (t - time[low]) / (time[high] - time[low]);
};

const state = { t: 0, playing: false, rate: 1 };
const r = run.size, wanted = path("wanted"), drawn = path("tool");
const ends = [Math.min, Math.max].map(pick => [0, 1, 2].map(i => drawn.reduce((a, p) => pick(a, p[i]), drawn[0][i])));
const painter = new Painter($("view"), [run.centre, r], [mix(...ends, 0.5), norm(add(...ends, -1)) / 2]);
const floor = Math.min(...arrays.points.data.filter((_, i) => i % 3 === 2)) - 0.01 * r;
const corners = triples([...arrays.faces.data]);
const bars = new Bars($("joints"), { ...run, limits: arrays.limits.data, speedLimit: arrays.speed_limit.data });
const charts = run.charts.map(c => new Chart($("side"), c, time, limited, t => { play(false); seek(t); }));
const HUES = { wanted: rgb(run.hues.wanted), drawn: rgb(run.hues.drawn), force: rgb(run.hues.force),
  dark: rgb("#4a5764"), touched: rgb("#cdbb9f") };
$("key").innerHTML = `<i style="color:${run.hues.wanted}"></i>path wanted<i style="color:${run.hues.drawn}"></i>path drawn`
  + (arrays.force ? `<i style="color:${run.hues.force}"></i>force of the tool` : "")
  + "<br>drag: turn, shift-drag: move, wheel: zoom, double click: near and far";
const caption = $("side").appendChild(document.createElement("p"));
caption.textContent = limited.some(Boolean) ? "time [s]; shaded where a limit is active" : "time [s]";

function triad(T, length, width, alpha, names) {
  const at = spot(T);
  ["#D62F2F", "#2E9E3F", "#2F62D6"].forEach((hue, i) => {
    const tip = add(at, [T[i], T[4 + i], T[8 + i]], length);
    painter.line([at, tip], rgb(hue), width, alpha, 0.03 * r);
    if (names) painter.text("xyz"[i], tip, hue);
  });
}

function draw() {
  const f = frameAt(state.t), i = Math.round(f);
  painter.begin(ink("--well"));
  const points = triples(between("points", f)), axes = triples(between("axes", f));
  const tool = between("tool", f), goal = between("wanted", f);
  painter.floor(floor, ink("--rule"));
  painter.shadow(points, floor, 0.05 * r, "rgba(0,0,0,0.10)");
  for (let k = 0; k < corners.length; k += 4) {
    const [a, b, c, d] = corners.slice(k, k + 4);
    painter.face([a, b, c, d], HUES.touched, unit(cross(add(b, a, -1), add(d, a, -1))), 0.5, 0.06 * r);
  }
  if (run.axis) {  // a door, from its axis to the tool
    const [a, b] = run.axis, out = add(spot(tool), a, -1), along = unit(add(b, a, -1));
    const arm = add(out, along, -dot(out, along));
    for (let k = 0; k < 8; k++) {
      const c = add(a, arm, k / 8), d = add(a, arm, (k + 1) / 8);
      painter.face([c, d, add(d, add(b, a, -1)), add(c, add(b, a, -1))], HUES.touched, null, 0.5);
    }
    painter.bar(a, b, 0.012 * r, 0.012 * r, HUES.dark, 4);
  }
  painter.line(wanted, HUES.wanted, 5, 0.75, 0.01 * r);
  painter.line([...drawn.slice(0, Math.floor(f) + 1), spot(tool)], HUES.drawn, 2, 1, 0.02 * r);
  const link = rgb(ink("--link")), m = axes.length, thick = 0.03 * r;
  painter.bar(add(points[0], [0, 0, -0.004 * r]), add(points[0], [0, 0, 0.012 * r]), 0.09 * r, 0.09 * r, HUES.dark);
  points.slice(1).forEach((p, k) => {
    const pieces = Math.max(1, Math.round(norm(add(p, points[k], -1)) / (0.1 * r)));
    const taper = s => thick * (1 - 0.45 * s / (m + 1));
    painter.bar(points[k], p, taper(k), taper(k + 1), link, pieces);
  });
  axes.forEach((u, k) => {
    const p = points[k + 1], hue = rgb(run.colours[k]), half = (run.slides[k] ? 0.075 : 0.052) * r;
    if (run.slides[k]) {  // a slide is a sleeve, drawn long and thin
      painter.bar(add(p, u, -half), add(p, u, half), 0.036 * r, 0.036 * r, hue, 2, HUES.dark);
      return;
    }
    painter.bar(add(p, u, -half), add(p, u, half), 0.045 * r, 0.045 * r, HUES.dark, 1, hue);
  });
  triad(goal, 0.13 * r, 2, 0.35, false);
  triad(tool, 0.13 * r, 3.5, 1, true);
  const told = [`t      ${state.t.toFixed(2)} s`];
  const error = run.charts[0].values, [mm, deg] = [error.data[i], error.data[frames + i]];
  told.push(`error  ${written(mm)} mm, ${written(deg)} deg`, `status ${run.status[i]}`);
  if (limited[i]) told.push("limit active");
  if (arrays.force) {
    const push = between("force", f), size = norm(push), at = spot(tool);
    told.push(`force  ${size.toFixed(2)} N`);
    if (size > 0) {
      const way = unit(push), tip = add(at, way, 0.35 * r * size / run.strongest), neck = add(tip, way, -0.06 * r);
      if (dot(add(neck, at, -1), way) > 0) painter.bar(at, neck, 0.014 * r, 0.014 * r, HUES.force, 3);
      painter.bar(neck, tip, 0.035 * r, 0.001 * r, HUES.force);
      painter.text(`${size.toFixed(1)} N`, tip, run.hues.force, at);
    }
  }
  painter.end();
  $("told").replaceChildren(...told.map(words => {
    const line = document.createElement("span");
    line.className = /^limit|^status (?!ok)/.test(words) ? "bad" : "";
    line.textContent = `${words}\n`;
    return line;
  }));
  for (const chart of charts) chart.draw(state.t);
  bars.draw(between("q", f), row("speed", i));
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
$("time").max = last;
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
setRate();
layout();
// page.html#2.5 opens at 2.5 s and does not play; without a number the page plays.
const moment = location.hash.length > 1 ? Number(location.hash.slice(1)) : NaN;
if (Number.isFinite(moment)) seek(moment); else play(true);
