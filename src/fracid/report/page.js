"use strict";
// What is where: the recordings' curves, the player that moves rig and cursors together, surfaces, keys, printing.

const DATA = JSON.parse(document.getElementById("samples").textContent);
const element = id => document.getElementById(id);
const CALM = matchMedia("(prefers-reduced-motion: reduce)");

// --- recordings: base64 to numbers, when first needed

class Trace {
  constructor(said) {
    this.said = said;
    this.t = floats(said.t);
    this.end = this.t.at(-1);
    this.outputs = said.outputs.map(o => ({ ...o, measured: floats(o.measured), fitted: floats(o.fitted) }));
  }

  // The value of a line at a time, between its samples; 0 where there is none.
  at(y, time) {
    let low = 0, high = this.t.length - 1;
    while (high - low > 1) { const m = (low + high) >> 1; if (this.t[m] <= time) low = m; else high = m; }
    const h = this.t[high] - this.t[low], s = h > 0 ? Math.min(Math.max((time - this.t[low]) / h, 0), 1) : 0;
    const v = (1 - s) * y[low] + s * y[high];
    return Number.isFinite(v) ? v : 0;
  }

  output(name) { return this.outputs.find(o => o.name === name); }

  angle(name, which, time) { const o = this.output(name); return o ? this.at(o[which], time) : 0; }

  step() { return this.end / Math.max(1, this.said.samples - 1); }
}

const traceOf = (() => {
  const made = new Map();
  return k => { if (!made.has(k)) made.set(k, new Trace(DATA.recordings[k])); return made.get(k); };
})();

// What is drawn of a recording: each output measured and fitted, and its residual.
function curves(trace) {
  const x = line(trace.t), shared = { x, xlabel: `time from ${round(trace.said.start, 6)} s on [s]`, xname: "time" };
  return trace.outputs.flatMap(o => {
    const residual = trace.t.map((_, i) => o.measured[i] - o.fitted[i]), unit = o.unit ? ` [${o.unit}]` : "";
    const band = o.step ? [{ axis: "y", from: -o.step / 2, to: o.step / 2, kind: "band" }] : [];
    return [
      { title: `${o.letter}, measured and fitted`, ylabel: o.letter + unit, height: 230, ...shared,
        series: [{ label: "measured", y: line(o.measured), kind: "measured" }, { label: "fitted", y: line(o.fitted), kind: "fitted" }] },
      { title: `${o.letter}, residual${o.step ? `; one encoder step of ${round(o.step, 3)}${o.unit} shaded` : ""}`, ylabel: `residual${unit}`,
        height: 140, ...shared, bands: band, series: [{ label: "measured − fitted", y: line(residual), kind: "residual", digits: 3 }] },
    ];
  });
}

// --- the player

class Player {
  constructor() {
    this.now = 0;
    this.playing = false;
    this.charts = [];
    this.busy = false;
    this.rigs = this.makeRigs();
    this.wire();
    this.open(0);
  }

  makeRigs() {
    if (!DATA.rig) return [];
    const camera = new Camera();
    const rigs = [["rig-measured", "measured"], ["rig-fitted", "fitted"]].map(([id, which]) =>
      Object.assign(new Rig(element(id), DATA.rig, camera), { which }));
    for (const rig of rigs) this.turnable(rig.canvas, camera);
    return rigs;
  }

  turnable(canvas, camera) {
    canvas.addEventListener("pointerdown", e => canvas.setPointerCapture(e.pointerId));
    canvas.addEventListener("pointermove", e => {
      if (!canvas.hasPointerCapture(e.pointerId)) return;
      camera.azimuth += 0.008 * e.movementX;
      camera.elevation = Math.min(Math.max(camera.elevation + 0.006 * e.movementY, -0.2), 1.5);
      this.show();
    });
  }

  open(k) {
    this.trace = traceOf(k);
    const poses = which => Array.from(this.trace.t, t => this.trace.angle("alpha", which, t) - this.rest());
    for (const rig of this.rigs) rig.frame([...poses("measured"), ...poses("fitted")]);
    this.window = [0, this.trace.end];
    const old = new Set(this.charts);
    Chart.all = Chart.all.filter(c => !old.has(c));
    element("shown").textContent = this.trace.said.name;
    element("traces").replaceChildren();
    this.charts = curves(this.trace).map(spec => this.chart(spec));
    const slider = element("time");
    slider.max = this.trace.end;
    slider.step = this.trace.step();
    this.seek(0);
  }

  // The offset of the pendulum's encoder [°].
  rest() { return DATA.rig ? DATA.rig.alphaRest[this.trace.said.name] || 0 : 0; }

  chart(spec) {
    const host = element("traces").appendChild(document.createElement("div"));
    host.className = "chart";
    host.tabIndex = 0;
    return new Chart(host, {
      ...spec,
      scaled: chart => this.follow(chart),
      built: chart => {
        const { over } = chart.plot;
        over.addEventListener("pointermove", e => !this.playing && !e.buttons && this.seek(chart.plot.posToVal(e.offsetX, "x"), chart));
        over.addEventListener("click", e => this.seek(chart.plot.posToVal(e.offsetX, "x")));
        over.addEventListener("dblclick", () => this.zoom(0, this.trace.end));
        if (this.window[0] > 0 || this.window[1] < this.trace.end) { this.busy = true; chart.zoom(...this.window); this.busy = false; }
        chart.point(this.now);
      },
    });
  }

  // One chart was zoomed: the others follow.
  follow(chart) {
    if (this.busy || !chart.plot || !this.charts.includes(chart)) return;
    const { min, max } = chart.plot.scales.x;
    if (min !== null && max !== null && (min !== this.window[0] || max !== this.window[1])) queueMicrotask(() => this.zoom(min, max));
  }

  zoom(from, to) {
    const least = 20 * this.trace.step();
    if (to - from < least) [from, to] = [(from + to - least) / 2, (from + to + least) / 2];
    this.window = [Math.max(0, from), Math.min(this.trace.end, to)];
    this.busy = true;
    for (const chart of this.charts) chart.zoom(...this.window);
    this.busy = false;
    queueMicrotask(() => this.charts.forEach(c => c.point(this.now)));
  }

  magnify(factor) {
    const [from, to] = this.window, about = Math.min(Math.max(this.now, from), to);
    this.zoom(about - (about - from) * factor, about + (to - about) * factor);
  }

  // Six swings from the start, as the pendulum's sign changes count them; a tenth of the record without any.
  firstSwings() {
    const { trace } = this, o = trace.outputs.at(-1), y = o.measured, mean = y.reduce((a, b) => a + b, 0) / y.length;
    let crossings = 0, k = 1;
    for (; k < y.length && crossings < 12; k++) if ((y[k] - mean) * (y[k - 1] - mean) < 0) crossings++;
    this.zoom(0, crossings === 12 ? trace.t[k - 1] : trace.end / 10);
  }

  seek(time, from = null) {
    this.now = Math.min(Math.max(time, 0), this.trace.end);
    for (const chart of this.charts) if (chart !== from) chart.point(this.now);
    element("time").value = this.now;
    this.show();
  }

  show() {
    const { now, trace } = this;
    element("clock").textContent = `${now.toFixed(2)} s`;
    element("time").setAttribute("aria-valuetext", `${now.toFixed(2)} seconds`);
    const rest = this.rest();
    for (const rig of this.rigs) {
      const pose = time => [trace.angle("theta", rig.which, time), trace.angle("alpha", rig.which, time) - rest];
      const moments = this.playing ? 24 : 0, trail = Array.from({ length: moments }, (_, k) => pose(Math.max(0, now - 0.35 * (1 - k / (moments - 1 || 1)))));
      const [theta, alpha] = pose(now);
      rig.draw(theta, alpha, trail);
      const name = rig.which === "fitted" ? "simulated" : "measured";
      rig.canvas.nextElementSibling.textContent = `${name}: ${trace.output("theta") ? `θ ${theta.toFixed(1)}°, ` : ""}α ${alpha.toFixed(1)}°`.replaceAll("-", "−");
    }
  }

  play(on = !this.playing) {
    if (on === this.playing) return;
    this.playing = on;
    const button = element("play");
    button.textContent = on ? "Pause" : "Play";
    button.setAttribute("aria-pressed", String(on));
    this.last = null;
    if (on) requestAnimationFrame(at => this.frame(at));
    else this.show();
  }

  // Plays what is seen, over and over.
  frame(at) {
    if (!this.playing) return;
    const [from, to] = this.window, seconds = this.last === null ? 0 : Math.min(at - this.last, 100) / 1000;
    this.last = at;
    const next = this.now + seconds * Number(element("speed").value);
    this.seek(next >= to || next < from ? from : next);
    requestAnimationFrame(t => this.frame(t));
  }

  wire() {
    element("play").addEventListener("click", () => this.play());
    element("time").addEventListener("input", e => this.seek(Number(e.target.value)));
    element("recording").addEventListener("change", e => { this.play(false); this.open(Number(e.target.value)); });
    const zooms = { in: () => this.magnify(0.5), out: () => this.magnify(2), start: () => { this.firstSwings(); this.seek(0); }, all: () => this.zoom(0, this.trace.end) };
    for (const button of document.querySelectorAll("[data-zoom]")) button.addEventListener("click", zooms[button.dataset.zoom]);
    element("player").addEventListener("keydown", e => this.key(e));
  }

  key(event) {
    const { tagName, type } = event.target;
    if (event.ctrlKey || event.metaKey || event.altKey || tagName === "SELECT") return;
    if (tagName === "BUTTON" && event.key === " ") return; // a button's own
    if (type === "range" && event.key !== " ") return;
    const step = event.shiftKey ? 1 : 5 * this.trace.step();
    const does = {
      " ": () => this.play(), ArrowLeft: () => this.seek(this.now - step), ArrowRight: () => this.seek(this.now + step),
      Home: () => this.seek(0), End: () => this.seek(this.trace.end), "+": () => this.magnify(0.5), "=": () => this.magnify(0.5),
      "-": () => this.magnify(2), 0: () => this.zoom(0, this.trace.end),
    }[event.key];
    if (!does) return;
    event.preventDefault();
    does();
  }
}

// --- charts that stand still

function whole(k) {
  const { whole: w } = DATA.recordings[k], x = line(floats(w.t).map(t => t + w.start));
  const kinds = ["first", "second", "third"], units = [...new Set(w.signals.map(s => s.unit))];
  return units.map(unit => ({
    title: w.signals.filter(s => s.unit === unit).map(s => s.letter).join(" and "),
    x, xlabel: "time on the recording's clock [s]", xname: "time", ylabel: `${unit === "°" ? "angle" : "input"} [${unit}]`.replace(" []", ""), height: 200,
    series: w.signals.filter(s => s.unit === unit).map((s, i) => ({ label: s.letter, y: line(floats(s.y)), kind: kinds[i % 3] })),
    bands: [{ axis: "x", from: w.window[0], to: w.window[1], kind: "window" }],
    marks: [
      { axis: "x", at: w.window[0], text: "used", kind: "link" }, { axis: "x", at: w.window[1], kind: "link" },
      ...(w.release === null ? [] : [{ axis: "x", at: w.release, text: "release", kind: "mark", solid: true, row: 1 }]),
    ],
  }));
}

const RESIDUALS = {
  acf: d => ({ title: "autocorrelation", x: line(floats(d.x)), xlabel: "lag [s]", xname: "lag", ylabel: "correlation", legend: true,
    series: [{ label: "correlation", y: line(floats(d.y)), kind: "first" }], bands: [{ axis: "y", from: -d.band, to: d.band, kind: "band" }] }),
  spectrum: d => ({ title: "spectrum", x: line(floats(d.x)), xlabel: "frequency [Hz]", xname: "frequency", ylabel: "power", logx: true, logy: true,
    series: [{ label: "power per Hz", y: line(floats(d.y)), kind: "first", digits: 2 }], marks: d.swing ? [{ axis: "x", at: d.swing, text: "swing" }] : [] }),
  normal: d => { const x = line(floats(d.x)); return { title: "normal probability plot", x, xlabel: "normal quantile", xname: "normal", ylabel: "residual / its spread",
    series: [{ label: "residual", y: line(floats(d.y)), kind: "points", digits: 3 }, { label: "normal", y: x, kind: "dashed", digits: 3 }] }; },
};

function residual(kind, recording, output) {
  const found = DATA.recordings.find(r => r.name === recording).residuals[output];
  return found && found[kind] ? [{ height: 190, ...RESIDUALS[kind](found[kind]) }] : [];
}

function profileChart(k) {
  const { profiles, threshold } = DATA.profiles, p = profiles[k], half = p.wald95 ? (p.wald95[1] - p.wald95[0]) / 3.92 : null;
  const top = 2.5 * (threshold || 3.84);
  const series = [{ label: "rise", y: p.rise.map(v => (v > 4 * top ? null : v)), kind: "first", digits: 3 }];
  if (half) series.push({ label: "parabola", y: p.values.map(v => ((v - p.best) / half) ** 2), kind: "dashed", digits: 3 });
  return [{ title: p.name, x: p.values, xlabel: p.unit ? `${p.name} [${p.unit}]` : p.name, xname: p.name, ylabel: "rise of the cost", height: 200, series,
    yrange: [-0.04 * top, top], marks: threshold ? [{ axis: "y", at: threshold, text: "95 %" }, { axis: "x", at: p.best, kind: "third" }] : [] }];
}

const SPECS = {
  whole: d => whole(Number(d.recording)),
  acf: d => residual("acf", d.recording, d.output),
  spectrum: d => residual("spectrum", d.recording, d.output),
  normal: d => residual("normal", d.recording, d.output),
  profile: d => profileChart(Number(d.profile)),
};

for (const host of document.querySelectorAll(".chart[data-kind]")) {
  for (const spec of SPECS[host.dataset.kind](host.dataset)) {
    const inner = host.appendChild(document.createElement("div"));
    new Chart(inner, spec);
  }
}

// --- surfaces

if (DATA.plane) {
  const p = DATA.plane, all = p.cost.flat().filter(v => v !== null), low = Math.min(...all), high = Math.max(Math.min(Math.max(...all), 100 * low), 1.2 * low);
  new Plane(element("plane"), element("plane-said"), {
    ...p, height: p.cost, low, high, names: p.names.map(n => `order ${n}`),
    levels: [1.1, 1.5, 2, 5, 10].map(m => ({ at: m * low, label: `×${m}` })),
    read: h => `cost ${round(h, 3)}, ${round(h / low, 3)} times the lowest`,
  });
}
if (DATA.profiles && DATA.profiles.joint) {
  const j = DATA.profiles.joint;
  new Plane(element("joint"), element("joint-said"), {
    ...j, height: j.rise.map(row => row.map(v => (v === null ? null : v + 0.3))), low: 0.3, high: 60, intervals: [],
    levels: [{ at: j.threshold + 0.3, label: "95 %" }], read: h => `rise ${round(h - 0.3, 3)}; the 95 % region ends at ${round(j.threshold, 3)}`,
  });
}

// --- the rest

const player = new Player();

const redraw = () => { Chart.rebuild(); Plane.all.forEach(p => p.draw()); player.show(); };
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
let waiting = 0;
addEventListener("resize", () => {
  clearTimeout(waiting);
  waiting = setTimeout(() => { Chart.resize(); Plane.all.forEach(p => p.draw()); player.show(); }, 120);
});

// On paper there is no choosing: the curves of the other recordings as well, all notes open, light colours.
const MOST_ON_PAPER = 12;
const onPaper = [];
addEventListener("beforeprint", () => {
  player.play(false);
  document.documentElement.dataset.print = "";
  DATA.recordings.slice(0, MOST_ON_PAPER).forEach((said, k) => {
    if (traceOf(k) === player.trace) return;
    const host = element("player").appendChild(document.createElement("div"));
    host.appendChild(document.createElement("h3")).textContent = said.name;
    onPaper.push(host, ...curves(traceOf(k)).map(spec => new Chart(host.appendChild(document.createElement("div")), spec)));
  });
  for (const d of document.querySelectorAll("details:not([open])")) { d.open = true; d.dataset.opened = ""; }
  Chart.rebuild(true);
  Plane.all.forEach(p => p.draw());
  player.show();
});
addEventListener("afterprint", () => {
  delete document.documentElement.dataset.print;
  const printed = new Set(onPaper.splice(0));
  Chart.all = Chart.all.filter(chart => !printed.has(chart));
  for (const one of printed) if (one instanceof Element) one.remove();
  for (const d of document.querySelectorAll("[data-opened]")) { d.open = false; delete d.dataset.opened; }
  redraw();
});

// It moves when it is first seen, unless the reader wants no motion.
if (DATA.rig && !CALM.matches) {
  const seen = new IntersectionObserver(entries => {
    if (!entries.some(e => e.isIntersecting)) return;
    seen.disconnect();
    if (!CALM.matches) player.play(true);
  }, { threshold: 0.6 });
  seen.observe(element("rigs"));
}
