"use strict";
// What is where: the recordings' curves, the player that moves rig and cursors together, surfaces, keys, printing.

// --- recordings: base64 to numbers, when first needed

class Trace {
  constructor(said) {
    this.said = said;
    this.t = floats(said.t);
    this.end = this.t.at(-1);
    this.outputs = said.outputs.map(o => ({ ...o, measured: floats(o.measured), fitted: floats(o.fitted), read: { unit: o.unit, step: o.step } }));
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

const timeAxis = start => (start ? `time after ${round(start, 6)} s [s]` : "time [s]");

// What is drawn of a recording: each output measured and simulated, and its residual.
function curves(trace) {
  const x = line(trace.t);
  return trace.outputs.flatMap((o, k) => {
    const last = k === trace.outputs.length - 1, alone = trace.outputs.length === 1, shared = { x, xname: "time", keyed: true, bare: !last, room: trace.outputs.some(o => o.step) ? 72 : 10 };
    const residual = trace.t.map((_, i) => o.measured[i] - o.fitted[i]), unit = o.unit ? ` [${o.unit}]` : "";
    const shaded = o.step ? `; shaded: ± ½ ${o.unit === "°" ? "encoder step" : "step"} of ${round(o.step, 3)}${o.unit === "°" ? "°" : ` ${o.unit}`}` : "";
    return [
      { title: o.letter, ylabel: o.letter + unit, xlabel: "", height: alone ? 290 : 138, ...shared, bare: true,
        series: [{ label: "measured", y: line(o.measured), kind: "measured", ...o.read }, { label: "simulated", y: line(o.fitted), kind: "fitted", ...o.read }] },
      { title: `${o.letter}, residual${shaded}`, ylabel: `residual${unit}`, xlabel: last ? timeAxis(trace.said.start) : "",
        height: alone ? 250 : last ? 148 : 110, yrange: [-o.limit, o.limit], right: o.right, rightlabel: o.step ? "steps" : "", ...shared,
        bands: o.step ? [{ axis: "y", low: -o.step / 2, high: o.step / 2, kind: "band" }] : [],
        series: [{ label: "residual", y: line(residual), kind: "residual", ...o.read, digits: 3, more: 1 }] },
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
    this.rig = drawing(element("rig"));
    if (this.rig) this.rig.turnable(() => this.show());
    this.wire();
    this.open(0);
  }

  open(k) {
    this.trace = traceOf(k);
    const poses = which => Array.from(this.trace.t, t => this.pose(which, t));
    if (this.rig) {
      this.rig.of(this.trace.said.name);
      this.rig.frame([...poses("measured"), ...poses("fitted")]);
    }
    this.window = [0, this.trace.end];
    this.loop = [0, this.firstSwings()];
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

  pose(which, time) { return posture(name => this.trace.angle(name, which, time)); }

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
    this.window = this.loop = [Math.max(0, from), Math.min(this.trace.end, to)];
    this.busy = true;
    for (const chart of this.charts) chart.zoom(...this.window);
    this.busy = false;
    queueMicrotask(() => this.charts.forEach(c => c.point(this.now)));
  }

  magnify(factor) {
    const [from, to] = this.window, about = Math.min(Math.max(this.now, from), to);
    this.zoom(about - (about - from) * factor, about + (to - about) * factor);
  }

  // Where six swings end, by sign changes of the simulated pendulum, which has no noise; a tenth of the record without any.
  firstSwings() {
    const { trace } = this, y = trace.outputs.at(-1).fitted, mean = y.reduce((a, b) => a + b, 0) / y.length;
    let crossings = 0, end = 0;
    for (let k = 1; k < y.length && crossings < 12; k++) if ((y[k] - mean) * (y[k - 1] - mean) < 0) [crossings, end] = [crossings + 1, k];
    return end ? trace.t[end] : trace.end / 10;
  }

  seek(time, from = null) {
    this.now = Math.min(Math.max(time, 0), this.trace.end);
    for (const chart of this.charts) if (chart !== from) chart.point(this.now);
    element("time").value = this.now;
    this.show();
  }

  // As simulated and as measured; the latter ten times as far away, where the reader asks for it.
  poses(time) {
    const factor = element("tenfold").checked ? 10 : 1, simulated = this.pose("fitted", time), measured = this.pose("measured", time);
    return { simulated, measured, ghost: simulated.map((v, k) => v + factor * (measured[k] - v)) };
  }

  show() {
    const { now, trace, rig } = this;
    element("clock").textContent = `${now.toFixed(2)} s`;
    element("time").setAttribute("aria-valuetext", `${now.toFixed(2)} seconds`);
    if (!rig) return;
    const { simulated, ghost } = this.poses(now);
    const moments = this.playing ? 24 : 0;
    const trail = Array.from({ length: moments }, (_, k) => this.poses(Math.max(0, now - 0.35 * (1 - k / (moments - 1 || 1)))).simulated);
    rig.draw(simulated, ghost, trail);
    const k = nearest(trace.t, now), shown = trace.outputs.filter(o => DATA.rig.outputs.some(d => d.name === o.name)); // the numbers beside the curves
    element("rig-said").textContent = shown.map(o => `${o.letter}\u00a0${inUnit(o.fitted[k], o.read)} (measured\u00a0${inUnit(o.measured[k], o.read)})`).join(", ");
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

  // Plays the first swings, or what the reader zoomed in on, over and over.
  frame(at) {
    if (!this.playing) return;
    const [from, to] = this.loop, seconds = this.last === null ? 0 : Math.min(at - this.last, 100) / 1000;
    this.last = at;
    const next = this.now + seconds * Number(element("speed").value);
    this.seek(next >= to || next < from ? from : next);
    requestAnimationFrame(t => this.frame(t));
  }

  wire() {
    element("play").addEventListener("click", () => this.play());
    element("time").addEventListener("input", e => { this.loop = this.window; this.seek(Number(e.target.value)); });
    element("tenfold").addEventListener("change", () => this.show());
    element("recording").addEventListener("change", e => { this.play(false); this.open(Number(e.target.value)); });
    const zooms = { in: () => this.magnify(0.5), out: () => this.magnify(2), start: () => { this.zoom(0, this.firstSwings()); this.seek(0); }, all: () => this.zoom(0, this.trace.end) };
    for (const button of document.querySelectorAll("[data-zoom]")) button.addEventListener("click", zooms[button.dataset.zoom]);
    element("player").addEventListener("keydown", e => this.key(e));
  }

  key(event) {
    const { tagName, type } = event.target;
    if (event.ctrlKey || event.metaKey || event.altKey || tagName === "SELECT") return;
    if ((tagName === "BUTTON" || type === "checkbox") && event.key === " ") return; // their own
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

for (const host of document.querySelectorAll(".chart[data-chart]")) new Chart(host, Chart.described(DATA.charts[host.dataset.chart]));

// --- surfaces

if (DATA.plane) new Plane(element("plane"), element("plane-said"), costOverOrders(DATA.plane));

// --- the rest

const player = new Player();

const redraw = () => { Chart.rebuild(); Plane.all.forEach(p => p.draw()); player.show(); };
let waiting = 0;
addEventListener("resize", () => {
  clearTimeout(waiting);
  waiting = setTimeout(() => { Chart.resize(); Plane.all.forEach(p => p.draw()); player.show(); }, 120);
});

element("theme").addEventListener("change", redraw);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);

// The section that is read is marked in the menu, and the menu follows.  The last sections are short and cannot come to the
// top: at the page's end it is the one that was asked for, or the last.
const menu = element("contents"), links = [...menu.querySelectorAll("a")].map(link => ({ link, section: element(link.hash.slice(1)) }));
function mark() {
  const end = scrollY + innerHeight >= document.documentElement.scrollHeight - 2;
  const seen = links.filter(({ section }) => !section.hidden && section.getBoundingClientRect().top < (end ? innerHeight : 0.25 * innerHeight));
  const { link } = end && seen.find(({ link }) => link.hash === location.hash) || seen.at(-1) || links[0];
  if (link.hasAttribute("aria-current")) return;
  for (const other of links) other.link.removeAttribute("aria-current");
  link.setAttribute("aria-current", "true");
  menu.scrollLeft = link.offsetLeft - menu.offsetLeft - (menu.clientWidth - link.offsetWidth) / 2;
}
for (const event of ["scroll", "hashchange", "resize"]) addEventListener(event, mark, { passive: true });
mark();

// Paper has the charts as SVG, in light colours, and all notes open.
addEventListener("beforeprint", () => {
  player.play(false);
  for (const d of document.querySelectorAll("details:not([open])")) { d.open = true; d.dataset.opened = ""; }
});
addEventListener("afterprint", () => {
  for (const d of document.querySelectorAll("[data-opened]")) { d.open = false; delete d.dataset.opened; }
});

// It moves when it is seen, unless the reader wants no motion.
if (DATA.rig && !CALM.matches) {
  const seen = new IntersectionObserver(entries => {
    if (!entries.some(e => e.isIntersecting)) return;
    seen.disconnect();
    if (!CALM.matches) player.play(true);
  }, { threshold: 0.6 });
  seen.observe(element("rig"));
}
