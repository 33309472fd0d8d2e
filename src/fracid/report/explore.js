"use strict";
// Explore: orders and frictions under sliders, and behind them the model, simulated anew by fracid's solver (Fracid).

const FRAME = 33; // ms: as long as a picture may take
const AGREES = 1e-6; // of the largest value: the page's solver against fracid's curve

const largest = values => values.reduce((most, v) => (Math.abs(v) > most ? Math.abs(v) : most), 0);

// How far an axis goes for a value: in few steps, for it to stay while a slider moves.
const roomFor = v => {
  const power = 10 ** Math.floor(Math.log10(v || 1));
  return [1.2, 2, 3, 5, 7.5, 12].map(m => m * power).find(room => room >= 1.04 * v);
};

// 10 to a whole power, the next above.
const power = v => (v > 0 ? `10${raised(Math.ceil(Math.log10(v)))}` : "rounding");

const doubles = text => new Float64Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);

class Explore {
  constructor(said) {
    Object.assign(this, said, { charts: [], portion: 1, searching: 0, now: 0, playing: false });
    this.byKind("parameters").forEach(s => { s.below = s.low; });
    const choice = element("explore-recording");
    this.intro = [...element("explore-intro").childNodes];
    this.recordings.forEach((r, k) => choice.append(new Option(r.use === "validate" ? `${r.name}, held out` : r.name, k)));
    choice.closest("label").hidden = this.recordings.length === 1;
    this.rows = this.sliders.map(s => this.row(s));
    choice.addEventListener("change", () => this.open(Number(choice.value)));
    element("explore-best").addEventListener("click", () => this.best());
    element("explore-integer").addEventListener("click", () => this.integer());
    element("explore-copy").addEventListener("click", () => this.copy());
    element("explore-view").addEventListener("click", () => this.look(this.view[1] < this.recording.t.at(-1) ? [0, this.recording.t.at(-1)] : this.firstSwings()));
    element("explore-play").addEventListener("click", () => this.play(!this.playing));
    element("explore-integer").hidden = this.sliders.every(s => s.integer === null);
    element("explore-ghost").hidden = !DATA.rig;
    this.rig = drawing(element("explore-rig"));
    if (this.rig) this.rig.turnable(() => this.draw());
    this.plane = DATA.plane && Plane.all.find(p => p.canvas.id === "plane");
    if (this.plane) this.plane.spec.pick = (a, b) => this.pick(a, b);
    this.open(0);
    this.recall();
  }

  byKind(kind) { return this.sliders.filter(s => s.kind === kind); }

  // --- sliders

  row(slider) {
    const id = `explore-${slider.name}`, host = element("explore-sliders").appendChild(document.createElement("div"));
    const make = (name, more, parent = host) => Object.assign(parent.appendChild(document.createElement(name)), more);
    host.className = "slide";
    host.dataset.place = `${this.sliders.indexOf(slider) + 1} of ${this.sliders.length}`;
    const label = make("label", { htmlFor: id, textContent: slider.letter });
    const said = make("small", { textContent: slider.free ? slider.says : `${slider.says}; given` }, label);
    const output = make("output", {}), track = make("div", { className: "track" });
    output.htmlFor.add(id);
    const parts = slider.interval ? [make("span", { className: "interval" }, track)] : [];
    const input = make("input", { type: "range", id }, track);
    const ticks = [make("span", { className: "tick" }, track)];
    if (slider.integer !== null) ticks.push(make("span", { className: "one", textContent: String(slider.integer) }, track));
    const row = { slider, input, output, said, parts, ticks };
    this.scale(row);
    input.addEventListener("input", () => {
      this.searching++;
      this.note = "";
      if (!this.moved && DATA.rig && !CALM.matches) this.play(true);
      this.moved = true;
      slider.now = Number(input.value);
      this.dragging = true;
      this.touch();
    });
    input.addEventListener("change", () => { this.dragging = false; this.touch(); });
    return row;
  }

  // Where a slider begins and ends, and where on it the estimate lies.
  scale({ slider, input, parts, ticks }) {
    Object.assign(input, { min: slider.low, max: slider.high, step: (slider.high - slider.low) / 2000 });
    const place = v => {
      const share = Math.min(Math.max((v - slider.low) / (slider.high - slider.low), 0), 1);
      return `calc(8px + ${share} * (100% - 16px))`;
    };
    for (const part of parts) {
      part.style.left = place(slider.interval[0]);
      part.style.right = `calc(100% - (${place(slider.interval[1]).slice(5, -1)}))`;
    }
    ticks.forEach((tick, k) => { tick.style.left = place(k ? slider.integer : slider.value); });
  }

  // --- what is simulated

  open(k) {
    this.searching++;
    const r = this.recording = this.recordings[k];
    if (!r.t) {
      Object.assign(r, { inputs: doubles(r.inputs), jumps: r.jumps && doubles(r.jumps), t: Float64Array.from({ length: r.samples }, (_, n) => n * r.step * r.every) });
      const drawn = DATA.recordings.find(one => one.name === r.name), of = (kind, name) => (r.own[kind] ? r.own[kind][name] : drawn.outputs.find(o => o.name === name)[kind]);
      for (const kind of ["measured", "fitted"]) r[kind] = this.outputs.map(o => floats(of(kind, o.name)));
    }
    Object.assign(this, { curves: [], residuals: [], rmse: [], note: "" });
    this.restore();
    const run = this.simulate();
    if (!r.fitted) r.fitted = run.outputs.map(y => y.slice());
    const off = this.outputs.map((o, k) => this.fill(run, k) / (largest(r.fitted[k]) || 1));
    element("explore").querySelectorAll(".explore, .scores, #explore-text, .controls button").forEach(e => { e.hidden = false; });
    element("explore-intro").replaceChildren(...this.intro);
    if (!(Math.max(...off) <= AGREES)) return this.refuse(Math.max(...off));
    this.agreement = Math.max(...off);
    this.bestLevels = [...this.rmse];
    this.bestMost = this.residuals.map(largest);
    this.build();
    return this.show(run);
  }

  refuse(off) {
    element("explore").querySelectorAll(".explore, .scores, #explore-text, .controls button").forEach(e => { e.hidden = true; });
    const said = element("explore-intro");
    said.textContent = `This recording cannot be explored: the page's solver differs from fracid's by ${round(off, 2)} of the largest value, more than rounding.`;
  }

  // All as the fit has it.
  restore() {
    for (const s of this.sliders) s.now = s.value;
    for (const u of this.recording.unknowns) u.now = u.value;
  }

  // What the run of the recording takes: the unknowns of the fit, and above them the sliders.
  values() {
    const r = this.recording, values = { orders: { ...this.orders }, parameters: { ...r.parameters } };
    for (const u of r.unknowns) for (const name of u.targets) values.parameters[name] = u.now;
    for (const s of this.sliders) for (const name of s.targets) values[s.kind][name] = s.now;
    const initial = r.initial.slice(), deflections = r.deflections.map(d => ({ ...d }));
    for (const u of r.unknowns) {
      if (u.state === null || u.now === u.value) continue;
      const share = deflections.find(d => d.state === u.state);
      if (share) share.share = u.now;
      else initial[u.state] = u.now;
    }
    return { ...values, initial, deflections };
  }

  simulate(portion = 1) {
    const r = this.recording, samples = Math.max(2, Math.round(portion * (r.samples - 1))), begin = performance.now();
    const { initial, deflections, ...values } = this.values(), steps = portion < 1 ? Math.min(samples * r.every, r.steps) : r.steps;
    const run = Fracid.simulate(this.program, { ...r, initial, deflections, steps, every: r.release === null ? r.every : 1, memory: r.steps }, values, this.model || model);
    if (r.release !== null) Object.assign(run, released(this.program, this.outputs, r, run, values.orders));
    this.measure(run, values.parameters);
    run.took = performance.now() - begin;
    return run;
  }

  // The outputs at the samples, in shown units: states, or functions of them, of the inputs (after a jump) and of the constants.
  measure(run, parameters) {
    const r = this.recording, { states, width } = this.program, u = r.jumps || r.inputs, driven = u.length > width;
    const functions = this.outputs.some(o => o.state === null) && (this.measures || modelOutputs)(parameters), f = new Float64Array(Math.max(...this.outputs.map(o => o.place)) + 1);
    run.outputs = this.outputs.map(() => new Float64Array(run.samples));
    for (let n = 0; n < run.samples; n++) {
      const x = run.states.subarray(n * states.length, (n + 1) * states.length), at = driven ? n * r.every * width : 0;
      if (functions) functions(x, u.subarray(at, at + width), f);
      this.outputs.forEach((o, k) => { run.outputs[k][n] = o.factor * (o.state === null ? f[o.place] : x[o.state]); });
    }
  }

  // The curve and the residual of an output, in shown units; shorter than the recording where the run is.
  fill(run, k) {
    const r = this.recording, m = r.measured[k], fitted = r.fitted[k];
    const curve = new Float64Array(run.samples), residual = new Float64Array(run.samples);
    let off = run.samples < r.samples ? Infinity : 0, sum = 0, count = 0;
    for (let n = 0; n < run.samples; n++) {
      const y = run.outputs[k][n], e = m[n] - y, d = Math.abs(y - fitted[n]);
      curve[n] = y;
      residual[n] = e;
      if (d > off) off = d;
      if (e === e) { sum += e * e; count++; }
    }
    this.curves[k] = curve;
    this.residuals[k] = count === run.samples ? residual : line(residual);
    this.rmse[k] = count ? Math.sqrt(sum / count) : null;
    return off;
  }

  // --- what is shown

  // The curves in a row, the residuals below them.
  build() {
    const { recording: r } = this, old = new Set(this.charts), host = element("explore-charts");
    Chart.all = Chart.all.filter(c => !old.has(c));
    host.replaceChildren();
    const shared = { x: r.t, xlabel: "time [s]", xname: "time", scaled: chart => this.follow(chart) };
    const unit = o => (o.unit ? ` [${o.unit}]` : "");
    const angles = this.outputs.map((o, k) => {
      const most = 1.15 * Math.max(largest(r.measured[k]), largest(r.fitted[k])), y = { measured: line(r.measured[k]) };
      const low = y.measured.reduce((least, v) => Math.min(least, v ?? least), most), high = y.measured.reduce((top, v) => Math.max(top, v ?? top), -most);
      return { title: o.letter, ylabel: o.letter + unit(o), height: 165, yrange: [low - 0.35 * (high - low || 1), high + 0.35 * (high - low || 1)], ...shared,
        series: [{ label: "measured", y: y.measured, kind: "measured", unit: o.unit }, { label: "simulated", y: () => this.curves[k], kind: "fitted", unit: o.unit }] };
    });
    const reach = this.outputs.map(() => 0);
    const residuals = this.outputs.map((o, k) => ({ title: `${o.letter}, residual`, ylabel: `residual${unit(o)}`, height: 120, ...shared,
      yrange: () => [-reach[k], reach[k]],
      grow: () => {
        const next = roomFor(Math.max(largest(this.residuals[k]), this.bestMost[k])), grown = next !== reach[k];
        reach[k] = next;
        return grown;
      },
      series: [{ label: "of the best fit", y: line(r.measured[k].map((v, n) => v - r.fitted[k][n])), kind: "measured", unit: o.unit, digits: 3, more: 1 },
        { label: "here", y: () => this.residuals[k], kind: "fitted", unit: o.unit, digits: 3, more: 1 }] }));
    this.live = [];
    this.charts = [...angles, ...residuals].map(spec => {
      const [, { y }] = spec.series;
      this.live.push(y);
      spec.series[1].y = y();
      const k = this.live.length - 1;
      if (spec.grow) spec.grow();
      spec.built = chart => {
        chart.plot.series[2].show = false;
        chart.plot.over.appendChild(document.createElement("canvas")).className = "live";
        chart.plot.hooks.draw.push(() => this.overlay(k));
        if (this.view) chart.zoom(...this.view);
      };
      return new Chart(host.appendChild(Object.assign(document.createElement("div"), { className: "chart" })), spec);
    });
    if (this.rig) {
      this.rig.of(r.name);
      this.rig.frame(Array.from({ length: r.samples }, (_, n) => this.pose(r.measured, n).map(v => 1.3 * v)));
    }
    this.look(this.firstSwings());
  }

  // The curve that moves, on a canvas of its own above what stays: what is drawn anew at each picture is one line.
  overlay(k) {
    const { plot, spec } = this.charts[k] || {}, canvas = plot && plot.over.querySelector(".live");
    if (!canvas || plot.scales.y.min === null) return;
    const ratio = devicePixelRatio || 1, width = plot.over.clientWidth, height = plot.over.clientHeight, ctx = canvas.getContext("2d");
    const { min, max } = plot.scales.x, { min: low, max: high } = plot.scales.y, y = spec.series[1].y, step = this.recording.step * this.recording.every;
    const first = Math.max(0, Math.floor(min / step)), last = Math.min(y.length - 1, Math.ceil(max / step)), bin = Math.max(1, Math.floor((last - first) / width));
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio))
      Object.assign(canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio), ariaHidden: "true" });
    ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    ctx.clearRect(0, 0, width, height);
    Object.assign(ctx, { strokeStyle: css("fitted"), lineWidth: 1.5, lineJoin: "bevel" });
    ctx.beginPath();
    const at = n => (y[n] === null ? 0 : ctx.lineTo((n * step - min) / (max - min) * width, (high - y[n]) / (high - low) * height));
    for (let n = first; n <= last; n += bin) {           // of many samples to a pixel the least and the greatest
      let least = n, most = n;
      for (let m = n + 1; m < n + bin && m <= last; m++) {
        if (y[m] < y[least]) least = m;
        if (y[m] > y[most]) most = m;
      }
      at(Math.min(least, most));
      if (least !== most) at(Math.max(least, most));
    }
    ctx.stroke();
  }

  // As long as the recording moves by more than a tenth of its most, and half as long again.
  firstSwings() {
    const r = this.recording, rest = r.fitted.map(y => y.at(-1));
    let last = 0;
    r.fitted.forEach((y, k) => {
      const most = y.reduce((top, v) => Math.max(top, Math.abs(v - rest[k])), 0);
      for (let n = 0; n < r.samples; n++) if (Math.abs(y[n] - rest[k]) > 0.15 * most) last = Math.max(last, n);
    });
    return [0, r.t[Math.min(r.samples - 1, Math.round(1.5 * last))]];
  }

  look(view) {
    const end = this.recording.t.at(-1);
    this.view = view;
    this.zooming = true;
    for (const chart of this.charts) chart.zoom(...view);
    this.zooming = false;
    element("explore-view").textContent = view[1] < end ? "Whole recording" : "Beginning";
  }

  // One chart was zoomed: the others follow.
  follow(chart) {
    if (this.zooming || !chart.plot || !this.charts.includes(chart)) return;
    const { min, max } = chart.plot.scales.x;
    if (min !== null && (min !== this.view[0] || max !== this.view[1])) queueMicrotask(() => this.look([min, max]));
  }

  touch() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.show(this.simulate(this.dragging ? this.portion : 1));
    });
  }

  show(run) {
    const begin = performance.now();
    this.outputs.forEach((_, k) => this.fill(run, k));
    this.zooming = true;
    this.charts.forEach((chart, k) => {
      chart.spec.series[1].y = this.live[k]();
      if (!chart.plot) return;
      chart.plot.setData([chart.spec.x, ...chart.spec.series.map(s => s.y)], false); // for the values under the cursor
      if (chart.spec.grow && chart.spec.grow()) chart.plot.redraw(true, true);
      else this.overlay(k);
    });
    this.zooming = false;
    for (const { slider, input, output, said } of this.rows) {
      input.value = slider.now;
      if (!slider.free) said.textContent = `${slider.says}; given${slider.now === slider.value ? "" : ` as ${round(slider.value, 3)}`}`;
      output.textContent = `${round(slider.now, slider.kind === "orders" ? 5 : 3)} ${slider.unit}`.trim();
      input.setAttribute("aria-valuetext", `${output.textContent}, estimate ${round(slider.value, 5)}`);
    }
    this.score(run);
    this.write();
    if (!this.dragging) this.remember();
    const [a, b] = DATA.plane ? DATA.plane.keys.map(name => this.values().orders[name]) : [];
    if (this.plane) this.plane.follow(a, b);
    this.draw();
    this.took = run.took;
    this.drawn = performance.now() - begin;
    const whole = run.took * (this.recording.samples / Math.max(2, run.samples));
    this.portion = Math.min(1, Math.max(0.05, (FRAME - Math.min(FRAME / 2, performance.now() - begin)) / whole));
  }

  score(run) {
    const r = this.recording, body = element("explore-scores");
    body.replaceChildren(...this.outputs.map((o, k) => {
      const row = document.createElement("tr"), now = this.rmse[k], unit = o.unit === "°" ? "°" : o.unit ? ` ${o.unit}` : "";
      const cells = [[o.letter, "th"], [run.completed ? round(now, 3) + unit : "diverges", "td"], [round(this.bestLevels[k], 3) + unit, "td"]];
      for (const [text, tag] of cells) Object.assign(row.appendChild(document.createElement(tag)), { textContent: text, className: tag === "td" ? "n" : "" });
      row.firstChild.scope = "row";
      return row;
    }));
    const whole = run.samples >= r.samples, seconds = round(r.t[Math.min(run.samples, r.samples) - 1], 3);
    const part = r.samples < r.whole ? ` The first ${round(r.t.at(-1), 4)} s of the recording.` : "";
    const away = this.outputs.findIndex((o, k) => this.rmse[k] > 3 * largest(r.measured[k]));
    const how = run.completed && away >= 0 ? `With these values the simulation leaves the recording: ${this.outputs[away].letter} reaches ${round(largest(this.curves[away]), 2)}${this.outputs[away].unit}.`
      : !run.completed ? `The run leaves its limits after ${seconds} s.`
      : whole ? `${r.steps.toLocaleString("en")} steps of ${inTime(r.step)}, simulated in ${Math.ceil(run.took)} ms.${this.preview ? "" : ` At the best fit this solver and fracid agree to ${power(this.agreement)} of the largest value.`}`
        : `While you drag: the first ${seconds} s; all of it when you let go.`;
    element("explore-said").textContent = (this.note ? `${this.note} ` : "") + how + part;
  }

  write() {
    const lines = values => values.flatMap(s => s.targets.map(name => `${name} = ${Number(s.now.toPrecision(6))}`));
    const sliders = this.byKind("parameters"), others = this.recording.unknowns.filter(u => u.now !== u.value && sliders.every(s => s.name !== u.name));
    const blocks = [["model.orders", lines(this.byKind("orders"))], ["model.parameters", lines([...sliders, ...others])]].filter(([, rows]) => rows.length);
    element("explore-toml").textContent = blocks.map(([name, rows]) => `[${name}]\n${rows.join("\n")}\n`).join("\n");
  }

  // --- the link: #recording=…&mu=0.95&b_alpha=…

  // Every value that is not the fit's, in the address of the page.
  remember() {
    const moved = [...this.sliders, ...this.recording.unknowns].filter(v => v.now !== v.value).map(v => [v.name, Number(v.now.toPrecision(6))]);
    if (!moved.length && !this.linked) return;
    this.linked = true;
    const recording = this.recording === this.recordings[0] ? this.link || [] : [["recording", this.recording.name]];
    history.replaceState(null, "", `#${moved.length || recording.length ? new URLSearchParams([...recording, ...moved]) : "explore"}`);
  }

  // What the link that was followed has.
  recall() {
    const said = new URLSearchParams(location.hash.slice(1)), k = this.recordings.findIndex(r => r.name === said.get("recording"));
    if (k > 0) {
      element("explore-recording").value = k;
      this.open(k);
    }
    for (const v of [...this.sliders, ...this.recording.unknowns]) {
      const now = said.has(v.name) ? Number(said.get(v.name)) : NaN;
      if (Number.isFinite(now)) v.now = Math.min(Math.max(now, v.kind === "orders" ? v.low : v.below ?? v.lower ?? -Infinity), v.kind === "orders" ? v.high : v.upper ?? Infinity);
    }
    this.widen();
    this.touch();
  }

  async copy() {
    const text = element("explore-toml"), button = element("explore-copy");
    try {
      await navigator.clipboard.writeText(text.textContent);
      button.textContent = "Copied";
    } catch { // a browser that does not let a page of a file do so
      element("explore-text").open = true;
      getSelection().selectAllChildren(text);
      button.textContent = "Press Ctrl+C to copy";
    }
    setTimeout(() => { button.textContent = "Copy as TOML"; }, 2000);
  }

  // --- two models, and a point of the map

  best() {
    this.searching++;
    this.note = "";
    this.restore();
    this.touch();
  }

  pick(a, b) {
    this.searching++;
    this.note = "";
    DATA.plane.keys.forEach((name, k) => { const s = this.sliders.find(one => one.name === name); if (s) s.now = [a, b][k]; });
    this.touch();
  }

  // Every order at its integer value, and all else that was free, and the frictions, found again for this recording:
  // Levenberg's and Marquardt's method, a picture a step.
  async integer() {
    const mine = ++this.searching, frictions = this.byKind("parameters"), shown = new Set(frictions.map(s => s.name));
    const unknowns = [
      ...frictions.map(s => ({ of: s, lower: s.lower ?? s.below, upper: s.upper ?? Infinity, width: s.high - s.low })),
      ...this.recording.unknowns.filter(u => u.state !== null || !shown.has(u.name)).map(u => ({ of: u, lower: u.lower ?? -Infinity, upper: u.upper ?? Infinity, width: u.width })),
    ];
    for (const s of this.sliders) if (s.integer !== null) s.now = s.integer;
    this.note = "Integer order: refitting …";
    this.touch();
    const picture = () => new Promise(done => requestAnimationFrame(done));
    const put = x => unknowns.forEach((u, k) => { u.of.now = Math.min(Math.max(x[k], u.lower), u.upper); });
    const search = leastSquares(unknowns, unknowns.map(u => u.of.now), x => { put(x); return this.errors(); });
    let best = unknowns.map(u => u.of.now);
    for (let step = search.next(); !step.done; step = search.next()) {
      best = step.value || best;
      put(best);                                         // a simulation leaves the values that it was made with
      if (step.value) {
        this.widen();
        this.touch();
      }
      await picture();
      if (mine !== this.searching) return;
    }
    put(best);
    const ended = unknowns.filter(u => u.of.letter && u.of.upper !== undefined && (u.of.now === u.lower || u.of.now === u.upper)).map(u => u.of.letter);
    this.note = `Integer order: the free values and the frictions shown, refitted to this recording by least squares${this.cost ? `; the run minimised ${this.cost}` : ""}.`
      + (this.recording.use === "validate" ? " The run held this recording out." : "") + (ended.length ? ` At a bound of the project: ${ended.join(", ")}.` : "");
    this.touch();
  }

  // Measured less simulated, all outputs in a row, as the fit weighs them; null where the run ends early.
  errors() {
    const run = this.simulate(), { measured, samples } = this.recording;
    if (!run.completed) return null;
    const errors = new Float64Array(samples * this.outputs.length);
    this.outputs.forEach(({ factor }, k) => {
      const level = this.levels ? this.bestLevels[k] : factor;
      for (let n = 0; n < samples; n++) {
        const e = measured[k][n] - run.outputs[k][n];
        errors[k * samples + n] = e === e ? e / level : 0;
      }
    });
    return errors;
  }

  widen() {
    for (const row of this.rows) {
      const s = row.slider;
      if (s.now <= s.high) continue;
      s.high = 1.3 * s.now;
      this.scale(row);
    }
  }

  // --- the ghost

  play(on) {
    this.playing = on;
    const button = element("explore-play");
    button.textContent = on ? "Pause" : "Play";
    button.setAttribute("aria-pressed", String(on));
    this.last = null;
    if (on) requestAnimationFrame(at => this.frame(at));
  }

  frame(at) {
    if (!this.playing) return;
    const [begin, end] = this.view;
    this.now += this.last === null ? 0 : Math.min(at - this.last, 100) / 1000;
    if (this.now > end || this.now < begin) this.now = begin;
    this.last = at;
    this.draw();
    requestAnimationFrame(next => this.frame(next));
  }

  pose(lines, n) {
    return posture(name => {
      const at = this.outputs.findIndex(o => o.name === name), v = at < 0 ? 0 : lines[at][n];
      return Number.isFinite(v) ? v : 0;
    });
  }

  // The rig at one moment: simulated, and as a ghost where it was measured.
  draw() {
    if (!this.rig) return;
    const { recording: r } = this, n = Math.min(r.samples - 1, Math.round(this.now / (r.step * r.every)));
    this.rig.draw(this.pose(this.curves, n), this.pose(r.measured, n), []);
    element("explore-clock").textContent = `${this.now.toFixed(2)} s`;
  }
}

// It begins when it is nearly seen: a page that is only read simulates nothing.
let explore = null;
if (DATA.explore) {
  element("explore").hidden = false;
  document.documentElement.classList.toggle("embed", new URLSearchParams(location.search).has("embed"));
  const linked = new URLSearchParams(location.hash.slice(1));
  if (DATA.explore.sliders.some(s => linked.has(s.name))) element("explore").scrollIntoView({ behavior: "instant" });
  const near = new IntersectionObserver(entries => {
    if (!entries.some(e => e.isIntersecting)) return;
    near.disconnect();
    explore = new Explore(DATA.explore);
  }, { rootMargin: "300px" });
  near.observe(element("explore"));
  const draw = () => explore && explore.draw();
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  element("theme").addEventListener("change", draw);
  addEventListener("resize", draw);
}
