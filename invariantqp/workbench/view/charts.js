// Curves over time with a cursor, and bars of joints in their ranges.

const ink = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const written = x => {
  const size = Math.abs(x);
  return size >= 1e4 || (size > 0 && size < 1e-3) ? x.toExponential(1) : `${+x.toPrecision(3)}`;
};

class Chart {
  // A chart's curves, the times of the frames, in which of them a limit is active, and when the run ends.
  constructor(side, chart, { time, limited, last }, seek) {
    Object.assign(this, { chart, time, limited, last });
    const head = side.appendChild(document.createElement("h2"));
    head.append(chart.title);
    if (chart.keyed) chart.names.forEach((name, i) => {
      const key = head.appendChild(document.createElement("small"));
      key.style.setProperty("--colour", chart.colours[i]);
      key.append(name);
    });
    this.canvas = side.appendChild(document.createElement("canvas"));
    this.canvas.className = "chart";
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `${chart.title} over time`);
    this.sheet = document.createElement("canvas");  // what does not move, drawn once
    const at = e => seek(this.timeAt(e.offsetX));
    this.canvas.addEventListener("pointerdown", e => { this.canvas.setPointerCapture(e.pointerId); at(e); });
    this.canvas.addEventListener("pointermove", e => { if (e.buttons) at(e); });
  }

  // The vertical axis: [low, high, ticks], as exponents of ten if it is logarithmic.
  axis() {
    const { log, span, values, levels } = this.chart;
    const all = [...values.data, ...levels].filter(Number.isFinite).map(x => log ? Math.log10(x) : x);
    let low = all.reduce((a, b) => Math.min(a, b), Infinity), high = all.reduce((a, b) => Math.max(a, b), -Infinity);
    if (span) [low, high] = span;
    else if (log) {  // seven decades at most: what is smaller lies along the bottom
      high = Math.ceil(high);
      low = Math.min(high - 1, Math.max(Math.floor(low), high - 7));
    }
    else { const room = 0.08 * (high - low) || 0.5; low -= room; high += room; }
    const rough = (high - low) / Math.max(2, (this.canvas.clientHeight - 26) / 17);  // ticks 17 pixels apart
    const ten = 10 ** Math.floor(Math.log10(rough));
    let step = ten * [1, 2, 5, 10].find(s => s * ten >= rough);
    if (log) step = Math.max(1, Math.ceil(step));
    const ticks = [];
    for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) ticks.push(i * step);
    return [low, high, ticks];
  }

  timeAt(x) {
    const [left, right] = [46, this.canvas.clientWidth - 8];
    return this.last * Math.min(1, Math.max(0, (x - left) / (right - left)));
  }

  // Draw everything but the cursor once, on a canvas of its own.
  layout() {
    const { canvas, sheet, chart, time, limited, last } = this, fine = window.devicePixelRatio || 1;
    const w = canvas.clientWidth, h = canvas.clientHeight;
    canvas.width = sheet.width = Math.round(w * fine);
    canvas.height = sheet.height = Math.round(h * fine);
    const pen = sheet.getContext("2d"), [low, high, ticks] = this.axis();
    pen.setTransform(fine, 0, 0, fine, 0, 0);
    const x = t => 46 + t / last * (w - 54), y = v => 6 + (high - v) / (high - low) * (h - 26);
    pen.font = "11px system-ui, sans-serif";
    pen.fillStyle = ink("--well");
    limited.forEach((on, i) => {
      if (on && i) pen.fillRect(x(time[i - 1]), 6, x(time[i]) - x(time[i - 1]) + 0.5, h - 26);
    });
    pen.textBaseline = "middle";
    pen.lineWidth = 1;
    for (const v of ticks) {
      pen.strokeStyle = ink("--rule");
      pen.beginPath(); pen.moveTo(46, y(v)); pen.lineTo(w - 8, y(v)); pen.stroke();
      pen.fillStyle = ink("--quiet"); pen.textAlign = "right";
      pen.fillText(chart.log ? (Math.abs(v) < 3 ? `${+(10 ** v).toPrecision(1)}` : `1e${v}`) : written(v), 41, y(v));
    }
    pen.textBaseline = "alphabetic"; pen.textAlign = "center";
    const every = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60].find(s => last / s <= 8) || last;
    for (let t = 0; t <= last * 1.0001; t += every) pen.fillText(written(+t.toPrecision(6)), x(t), h - 5);
    pen.setLineDash([4, 3]); pen.strokeStyle = ink("--quiet");
    for (const v of chart.levels) { pen.beginPath(); pen.moveTo(46, y(v)); pen.lineTo(w - 8, y(v)); pen.stroke(); }
    pen.setLineDash([]);
    pen.save(); pen.beginPath(); pen.rect(46, 5, w - 54, h - 24); pen.clip();
    pen.lineWidth = 1.5; pen.lineJoin = "round";
    const [curves, k] = chart.values.shape;
    for (let c = 0; c < curves; c++) {
      pen.strokeStyle = chart.colours[c];
      pen.beginPath();
      for (let i = 0; i < k; i++) {
        const v = chart.values.data[c * k + i];
        pen.lineTo(x(time[i]), y(chart.log ? Math.log10(v) : v));
      }
      pen.stroke();
    }
    pen.restore();
    this.x = x;
  }

  draw(t) {
    const pen = this.canvas.getContext("2d"), fine = window.devicePixelRatio || 1;
    pen.setTransform(1, 0, 0, 1, 0, 0);
    if (!this.sheet.width || !this.sheet.height) return;  // a window without area has nothing to copy
    pen.clearRect(0, 0, this.canvas.width, this.canvas.height);
    pen.drawImage(this.sheet, 0, 0);
    pen.setTransform(fine, 0, 0, fine, 0, 0);
    pen.strokeStyle = ink("--ink");
    pen.lineWidth = 1.2;
    pen.beginPath(); pen.moveTo(this.x(t), 5); pen.lineTo(this.x(t), this.canvas.clientHeight - 19); pen.stroke();
  }
}

// A rotary quantity in degrees, or one of a slide in metres, with its unit; "-0.0" is "0.0".
const measured = (x, slide, per) => {
  const number = slide ? written(x) : (x * 180 / Math.PI).toFixed(1).replace("-0.0", "0.0");
  return `${number}${slide ? " m" : "°"}${per}`;
};

// One row a joint: its position and where that is in its range, its velocity and what share that is of its limit.
class Bars {
  constructor(table, run) {
    this.run = run;
    table.innerHTML = "<tr><th></th><th colspan=2>position, in its range</th><th colspan=2>velocity, of its limit</th></tr>";
    const cell = row => row.appendChild(document.createElement("td"));
    this.rows = run.joints.map((name, i) => {
      const row = table.appendChild(document.createElement("tr"));
      row.style.setProperty("--colour", run.colours[i]);
      const label = cell(row);
      label.textContent = label.title = name;
      const bar = () => {
        const well = document.createElement("div");
        well.className = "bar";
        well.append(document.createElement("b"));
        return well;
      };
      const place = bar(), speed = bar();
      cell(row).append(place);
      const position = cell(row);
      cell(row).append(speed);
      return { place, position, speed, velocity: cell(row) };
    });
  }

  draw(q, speed) {
    const { limits, speedLimit, slides } = this.run, m = q.length;
    this.rows.forEach((row, i) => {
      const low = limits[i], high = limits[m + i], share = (q[i] - low) / (high - low);
      const ranged = Number.isFinite(share);
      row.place.hidden = !ranged;
      if (ranged) {
        row.place.firstChild.style.cssText = `left:calc(${Math.min(1, Math.max(0, share))} * (100% - 6px));width:6px`;
        row.place.classList.toggle("at", share < 0.002 || share > 0.998);
      }
      row.position.textContent = measured(q[i], slides[i], "");
      row.velocity.textContent = measured(speed[i], slides[i], "/s");
      const of = speed[i] / speedLimit[i], filled = 50 * Math.min(1, Math.abs(of));
      row.speed.firstChild.style.cssText = `left:${of < 0 ? 50 - filled : 50}%;width:${filled}%`;
      row.speed.classList.toggle("at", Math.abs(of) > 0.999);
    });
  }
}
