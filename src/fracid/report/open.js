"use strict";
// The page that opens a recording: read, guessed, corrected, fitted, explored, and handed on as a project.

const SLICE = 24;                                        // ms: as long as the fit may keep the page waiting

for (const [name, spec] of Object.entries(DATA.models)) Object.assign(spec, { model: MODELS[name], measures: OUTPUTS[name] || null });

const make = (name, more, parent) => { const made = Object.assign(document.createElement(name), more); if (parent) parent.append(made); return made; };
const listed = names => names.join(", ").replace(/, ([^,]*)$/, " and $1");

class Page {
  constructor() {
    this.blank = element("explore").cloneNode(true);     // Explore as it begins: each fit has a new one
    this.fits = 0;
    for (const name of Object.keys(DATA.models)) element("model").append(new Option(name, name));
    for (const rig of DATA.models["rotary-pendulum"].rigs) element("rig").append(new Option(`${rig.name}: ${rig.title}`, rig.name));
    element("file").addEventListener("change", e => { if (e.target.files[0]) this.read(e.target.files[0]); e.target.value = ""; });
    element("example").addEventListener("click", () => this.open(example()));
    element("model").addEventListener("change", e => this.take(Drafting.guess(this.table, DATA.models, DATA.units, e.target.value)));
    element("rig").addEventListener("change", e => { this.setup.rig = e.target.value; this.changed(); });
    for (const end of ["from", "to"]) element(end).addEventListener("change", e => { this.setup[end] = e.target.value === "" ? null : Number(e.target.value); this.setup.held &&= end === "to"; this.changed(); });
    element("fit").addEventListener("click", () => this.fit());
    element("stop").addEventListener("click", () => this.stop());
    element("save").addEventListener("click", () => this.save());
    element("copy").addEventListener("click", () => this.copy());
    for (const event of ["dragover", "dragleave", "drop"]) addEventListener(event, e => {
      e.preventDefault();
      element("drop").classList.toggle("over", event === "dragover");
      if (event === "drop" && e.dataTransfer.files[0]) this.read(e.dataTransfer.files[0]);
    });
    if (DATA.table) this.open({ ...DATA.table, columns: DATA.table.columns.map(doubles) });
  }

  // --- a file

  async read(file) {
    if (/\.(mat|npz|npy|h5|hdf5|parquet|xlsx|tdms|mdf|mf4|mcap|db3|json|jsonl)$/i.test(file.name)) return this.refuse(`${file.name} is not read by a browser; fracid does: fracid open ${file.name}`);
    if (file.size > 1 << 26) return this.refuse(`${file.name} has ${Math.round(file.size / 1e6)} MB, more than this page takes. Type fracid init ${file.name}.`);
    const table = Reading.parse(Reading.decode(new Uint8Array(await file.arrayBuffer())), file.name);
    return table.error ? this.refuse(table.error) : this.open(table);
  }

  refuse(why) {
    this.stop();
    element("file-said").textContent = why;
    for (const id of ["guess", "found", "explore", "project"]) element(id).hidden = true;
  }

  open(table) {
    this.table = table;
    element("file-said").textContent = `${table.name}: ${table.rows.toLocaleString("en")} rows, ${listed(table.names)}${table.said ? `; ${table.said}` : ""}.`;
    element("guess").hidden = false;
    const setup = this.linked(Drafting.guess(table, DATA.models, DATA.units));
    this.take(setup);
    if (setup) this.fit();
  }

  // --- what it is

  get spec() { return DATA.models[this.setup.model]; }

  // Nobody knows what it is: a model is chosen, or there is none for it.
  ask() {
    this.stop();
    element("model").value = "";
    element("about").textContent = "No model of the library has columns of these names. Choose one and say what its columns are, or write the equations of your own in a project.";
    for (const id of ["rig-choice", "chosen", "found", "explore", "project"]) element(id).hidden = true;
  }

  take(setup) {
    if (!setup) { this.ask(); return; }
    this.setup = setup;
    element("chosen").hidden = false;
    element("model").value = setup.model;
    element("about").textContent = this.spec.about;
    element("rig-choice").hidden = !this.spec.rigs;
    element("rig").value = setup.rig;
    this.free = null;
    this.rows();
    this.changed();
  }

  // What each column is, a row a signal.
  rows() {
    const { table, spec, setup } = this, body = document.querySelector("#columns tbody");
    body.replaceChildren();
    const row = (label, about, column, none, change) => {
      const tr = make("tr", {}, body), cell = () => make("td", {}, tr);
      make("th", { scope: "row", textContent: label }, tr).append(make("small", { textContent: about }));
      const select = make("select", { ariaLabel: `Column of ${label}` }, cell());
      select.append(new Option(none, ""), ...table.names.map((name, c) => new Option(name, c)));
      select.value = column ?? "";
      select.addEventListener("change", () => change(select.value === "" ? null : Number(select.value)));
      return cell;
    };
    const cell = row("time", "", setup.time.column, "none: a rate", c => { setup.time.column = c; setup.time.rate = c === null ? 100 : null; this.begin(); });
    if (setup.time.rate) make("span", { textContent: " Hz" }, this.number(cell(), "Samples a second", setup.time.rate, v => { setup.time.rate = v > 0 ? v : 100; this.begin(); }));
    else this.units(cell(), "time", Object.keys(DATA.units.time), setup.time.unit, u => { setup.time.unit = u; this.begin(); });
    cell();
    for (const { name, unit } of [...spec.outputs, ...spec.inputs]) {
      const s = setup.signals[name], of = spec.outputs.some(o => o.name === name) ? "measured" : "drives it";
      const next = row(name, `${of} [${unit}]`, s && s.column, "not recorded", c => {
        if (c === null) delete setup.signals[name];
        else setup.signals[name] = { column: c, unit: Object.hasOwn(DATA.units.signal, unit) ? unit : "1", counts: 4096, zero: 0, ...s && { unit: s.unit } };
        this.begin();
      });
      if (!s) { next(); next(); continue; }
      const place = next(), possible = Object.keys(DATA.units.signal).filter(u => DATA.units.signal[u].of === unit);
      this.units(place, name, possible.length ? possible : ["1"], s.unit, u => { s.unit = u; this.begin(); });
      if (s.unit === "counts") this.number(place, `Counts a turn of ${name}`, s.counts, v => { s.counts = v > 0 ? Math.round(v) : 4096; this.begin(); });
      this.number(next(), `Zero of ${name} [${unit}]`, s.zero, v => { s.zero = Number.isFinite(v) ? v : 0; this.changed(); });
    }
  }

  units(place, label, names, value, change) {
    const select = make("select", { ariaLabel: `Unit of ${label}` }, place);
    select.append(...names.map(u => new Option(u, u)));
    select.value = value;
    select.addEventListener("change", () => change(select.value));
  }

  number(place, ariaLabel, value, change) {
    const input = make("input", { type: "number", step: "any", value, ariaLabel }, place);
    input.addEventListener("change", () => change(Number(input.value)));
    return place;
  }

  begin() {
    Drafting.begin(this.table, this.spec, DATA.units, this.setup);
    this.rows();
    this.changed();
  }

  // A signal or the part that is fitted is another.
  changed() {
    const { setup, spec } = this;
    this.stop();
    this.recording = Preview.recordingOf(this.table, spec, this.columns());
    if (!this.free) this.free = new Set(spec.parameters.filter(p => this.sought(p)).map(p => p.name));
    element("from").value = setup.from ?? "";
    element("to").value = setup.to ?? "";
    element("release").textContent = setup.held ? "It is held until then, and let go." : "";
    for (const id of ["found", "explore", "project"]) element(id).hidden = true;
    this.list();
    this.draw();
    element("fit").disabled = !this.ready();
    element("fit-said").textContent = this.ready() ? `${this.recording.whole.toLocaleString("en")} samples${this.recording.thin > 1 ? `, every ${this.recording.thin}th of which the preview takes` : ""}.` : "Choose the columns of what was measured, and a part of at least 20 samples in which they move.";
  }

  columns() {
    const { time, signals, from, to, held } = this.setup, { units } = DATA;
    return { from, to, held, time: { ...time, factor: units.time[time.unit].factor },
      signals: Object.fromEntries(Object.entries(signals).map(([name, s]) => [name, { ...s, factor: Drafting.factorOf(s, units) }])) };
  }

  ready() { return this.recording !== null && this.spec.needs.every(n => n in this.setup.signals); }

  // Whether a constant is to be found from such a recording.
  sought({ name, free }) {
    const { without } = this.spec;
    if (this.still() && without.fixed.includes(name)) return false;
    return free === "always" || free === (this.recording?.driven ? "driven" : "undriven");
  }

  still() { const { without } = this.spec; return without && !(without.output in this.setup.signals); }

  given() {
    const { spec } = this, rig = spec.rigs && spec.rigs.find(r => r.name === this.setup.rig);
    const parameters = Object.fromEntries(spec.parameters.map(p => [p.name, p.value])), still = this.still();
    return { free: this.free, parameters: { ...parameters, ...rig && rig.parameters, ...still && spec.without.parameters }, fixedOrders: still ? spec.without.orders : {} };
  }

  list() {
    const { spec, free } = this, say = () => { element("free-said").textContent = `${free.size} constants, ${spec.orders.length} order${spec.orders.length === 1 ? "" : "s"}`; };
    element("free-list").replaceChildren(...spec.parameters.map(p => {
      const label = make("label"), input = make("input", { type: "checkbox", checked: free.has(p.name) }, label);
      label.append(` ${p.name}`, make("small", { textContent: p.about }));
      input.addEventListener("change", () => { if (input.checked) free.add(p.name); else free.delete(p.name); say(); });
      return label;
    }));
    say();
  }

  // The signals as recorded, and between which times they are fitted.
  draw() {
    const { table, setup, spec } = this, host = element("raw"), { time, signals } = this.columns(), { kept, t } = Preview.clock(table, time);
    Chart.all = Chart.all.filter(c => c.host !== host);
    host.replaceChildren();
    const shown = spec.outputs.filter(o => o.name in signals);
    if (!shown.length || t.length < 3) return;
    const thin = Math.ceil(t.length / 4000), some = y => line(y.filter((_, n) => n % thin === 0)), alike = new Set(shown.map(o => o.shown)).size === 1;
    this.chart = new Chart(host, {
      title: "as recorded", x: Array.from(some(t)), xlabel: "time [s]", xname: "time", height: 180, keyed: false,
      ylabel: alike ? `[${shown[0].shown || "1"}]` : "",
      series: shown.map((o, k) => ({ label: o.letter, kind: ["first", "second", "third"][k % 3], unit: o.shown, y: some(Preview.signal(table, signals[o.name], kept).map(v => o.factor * v)) })),
      bands: setup.from === null || setup.to === null ? [] : [{ axis: "x", low: setup.from, high: setup.to, kind: "window" }],
    });
  }

  // --- the fit

  stop() { this.fits++; element("stop").hidden = true; }

  async fit() {
    if (!this.ready()) return;
    this.stop();
    const mine = this.fits, { spec, recording: r } = this, setup = this.given(), search = Preview.fit(spec, r, setup), begun = performance.now();
    element("stop").hidden = false;
    let found = null;
    for (let end = performance.now() + SLICE; !found;) {
      const step = search.next();
      if (step.done) found = step.value;
      if (performance.now() < end && !found) continue;
      if (!found) element("fit-said").textContent = `${step.value.said[0].toUpperCase()}${step.value.said.slice(1)}: ${((performance.now() - begun) / 1000).toFixed(1)} s`;
      await new Promise(done => setTimeout(done));
      if (mine !== this.fits) { element("fit-said").textContent = "Stopped."; return; }
      end = performance.now() + SLICE;
    }
    element("stop").hidden = true;
    this.took = (performance.now() - begun) / 1000;
    element("fit-said").textContent = found.rmse ? `Fitted in ${this.took.toFixed(1)} s.` : "No simulation reaches the end of this part: another model, other units, or a shorter part?";
    if (found.rmse) this.show(found, setup);
  }

  show(found, setup) {
    const { spec, recording: r } = this, errors = r.shown.map((o, k) => `${o.letter} ${inUnit(o.factor * found.rmse[k], { unit: o.shown, digits: 3 })}`);
    this.found = found;
    const misfit = r.shown.some((o, k) => found.rmse[k] > 0.1 * r.range[k]);
    element("found").hidden = false;
    element("found-said").textContent = `RMSE ${listed(errors)}, ${r.samples.toLocaleString("en")} samples, least squares from ${this.took.toFixed(1)} s of search. ${misfit ? "The model does not follow the recording: check columns, units, zero and model before anything else." : "Whether such values can be trusted, and whether an order differs from its integer, only intervals and held-out recordings tell."}`;
    const body = document.querySelector("#values tbody");
    body.replaceChildren(...found.unknowns.filter(u => ["orders", "parameters"].includes(u.kind)).map(({ kind, name }) => {
      const tr = make("tr"), p = kind === "orders" ? { about: "order", unit: "" } : spec.parameters.find(one => one.name === name), q = spec.orders.find(one => one.name === name);
      make("th", { scope: "row", textContent: q ? q.letter : name }, tr);
      make("td", { className: "n", textContent: `${round(found.values[kind][name], 4)}${p.unit && p.unit !== "-" ? ` ${p.unit}` : ""}` }, tr);
      make("td", { textContent: p.about }, tr);
      return tr;
    }));
    this.explore(found, setup);
    this.text = Drafting.project(this.table, spec, this.setup, { values: found.values, free: setup.free, fixedOrders: setup.fixedOrders, rmse: `RMSE ${listed(errors)}`, units: DATA.units, unknowns: found.unknowns });
    const stem = this.table.name.replace(/\.[^.]*$/, "").replace(/[^\w.-]+/g, "-").slice(0, 60) || "recording";
    Object.assign(this, { projectName: `${stem}.toml` });
    element("command").textContent = `fracid fit ${this.projectName}`;
    element("toml").textContent = this.text;
    element("project").hidden = false;
  }

  // Explore of what was found, as in the report.
  explore(found, { fixedOrders }) {
    const { spec, setup } = this, r = this.recording, { values, unknowns } = found;
    const outputs = r.shown.map(({ name, letter, shown, factor, state, place }) => ({ name, letter, unit: shown, factor, state, place }));
    const slider = (kind, name, says, value, low, high, more) => ({ kind, name, letter: name, unit: "", says, value, interval: null, free: true, low, high, targets: [name], integer: null, ...more });
    const orders = spec.orders.filter(q => !(q.name in fixedOrders)).map(q => { const v = values.orders[q.name]; return slider("orders", q.name, "order", v, Math.max(0.02, Math.min(v, q.integer ?? v) - 0.15), Math.min(1.98, Math.max(v, q.integer ?? v) + 0.15), { letter: q.letter, integer: q.integer }); });
    const frictions = unknowns.filter(u => u.kind === "parameters").map(u => ({ u, p: spec.parameters.find(p => p.name === u.name) })).filter(({ p }) => p.friction && !p.rest).slice(0, 6)
      .map(({ u, p }) => { const v = values.parameters[p.name]; return slider("parameters", p.name, p.about, v, 0, 3 * Math.max(v, p.size), { unit: p.unit === "-" ? "" : p.unit, lower: u.lower, upper: u.upper }); });
    const others = unknowns.map((u, k) => ({ name: u.kind === "initial" ? spec.program.states[u.name] : u.name, state: u.kind === "initial" ? u.name : null, value: found.x[k], lower: u.lower, upper: u.upper, width: u.width, targets: u.kind === "parameters" ? [u.name] : [] })).filter((_, k) => !["orders", "release"].includes(unknowns[k].kind));
    Chart.all = Chart.all.filter(c => c.host === element("raw"));
    if (this.shown) this.shown.play(false);
    element("explore").replaceWith(this.blank.cloneNode(true));
    const moved = spec.scene && spec.scene.movedBy.some(n => n in setup.signals);
    DATA.rig = moved ? { ...spec.scene, outputs: spec.scene.outputs.map(name => ({ name, factor: spec.outputs.find(o => o.name === name).factor })), constants: { [this.table.name]: values.parameters }, made: SCENES[setup.model] } : null;
    element("explore").hidden = false;
    this.shown = new Explore({
      program: spec.program, model: spec.model, measures: spec.measures, preview: true, link: this.link(), orders: values.orders, outputs, levels: new Set(outputs.map(o => o.unit)).size > 1, cost: "", sliders: [...orders, ...frictions],
      recordings: [{ ...r, name: this.table.name, use: "fit", release: values.release, jumps: null, initial: values.initial, deflections: [], unknowns: others, parameters: values.parameters, own: {},
        t: Float64Array.from({ length: r.samples }, (_, n) => n * r.step), measured: r.measured.map((y, k) => Float32Array.from(y, v => outputs[k].factor * v)), fitted: null }],
    });
  }

  // --- the link: what was chosen, before what was moved

  link() {
    const { model, rig, time, signals, from, to } = this.setup;
    return [["model", model], ...(rig ? [["rig", rig]] : []), ["time", JSON.stringify(time)], ["signals", JSON.stringify(signals)], ["from", from], ["to", to]];
  }

  // A link's choices in place of what is guessed, as far as this table has them.
  linked(setup) {
    const said = new URLSearchParams(location.hash.slice(1)), { units } = DATA;
    if (!Object.hasOwn(DATA.models, said.get("model"))) return setup;
    const spec = DATA.models[said.get("model")], now = Drafting.guess(this.table, DATA.models, units, said.get("model"));
    try {
      const time = JSON.parse(said.get("time")), signals = JSON.parse(said.get("signals")), there = c => Number.isInteger(c) && c >= 0 && c < this.table.names.length;
      const known = [...spec.outputs, ...spec.inputs].map(s => s.name), sound = Object.entries(signals).every(([n, s]) => known.includes(n) && there(s.column) && Object.hasOwn(units.signal, s.unit) && s.counts > 0 && Number.isFinite(s.zero));
      if (!sound || !(time.rate > 0 || there(time.column)) || !Object.hasOwn(units.time, time.unit)) return setup;
      const rig = spec.rigs && spec.rigs.some(r => r.name === said.get("rig")) ? said.get("rig") : now.rig, ends = ["from", "to"].map(end => (said.get(end) === null || !Number.isFinite(Number(said.get(end))) ? now[end] : Number(said.get(end))));
      return { ...now, rig, time: { column: time.rate > 0 ? null : time.column, unit: time.unit, rate: time.rate > 0 ? time.rate : null }, signals: Object.fromEntries(Object.entries(signals).map(([n, { column, unit, counts, zero }]) => [n, { column, unit, counts, zero }])), from: ends[0], to: ends[1], held: now.held && ends[0] === now.from };
    } catch { return setup; }
  }

  // --- the project

  save() {
    const address = URL.createObjectURL(new Blob([this.text], { type: "application/toml" }));
    make("a", { href: address, download: this.projectName }).click();
    setTimeout(() => URL.revokeObjectURL(address), 10000);
  }

  async copy() {
    try {
      await navigator.clipboard.writeText(this.text);
      element("copy").textContent = "Copied";
    } catch {
      getSelection().selectAllChildren(element("toml"));
      element("copy").textContent = "Press Ctrl+C to copy";
    }
    setTimeout(() => { element("copy").textContent = "Copy"; }, 2000);
  }
}

// A release of a rotary pendulum, simulated by the page's solver with noise: λ = 0.95 and μ = 0.97 are true.
function example() {
  const spec = DATA.models["rotary-pendulum"], step = 0.01, held = 100, count = 800, states = spec.program.states.length;
  const parameters = { ...Object.fromEntries(spec.parameters.map(p => [p.name, p.value])), ...spec.rigs[0].parameters, b_theta: 0.05, b_alpha: 3e-4, coulomb_theta: 0.01, coulomb_alpha: 2e-4 };
  const r = { step, steps: count, samples: count + 1, every: 1, outputs: 0, limit: 1e4, inputs: new Float64Array(1), width: 1 };
  const run = Preview.simulated({ ...spec, measures: null }, r, { orders: { lambda: 0.95, mu: 0.97 }, parameters, initial: [0, 0, 1, 0], release: null });
  let seed = 1;
  const noise = () => 0.05 * ((seed = seed * 48271 % 2147483647) / 2147483647 - 0.5), degrees = (n, state) => 180 / Math.PI * run.states[Math.max(0, n - held) * states + state] + noise();
  const rows = held + count, column = f => Float64Array.from({ length: rows }, (_, n) => f(n));
  return { name: "example.csv", rows, names: ["time", "theta", "alpha"], units: ["s", "deg", "deg"], columns: [column(n => n * step), column(n => degrees(n, 0)), column(n => degrees(n, 2))], said: "simulated here, λ = 0.95 and μ = 0.97" };
}

const page = new Page();
const redraw = () => { Chart.rebuild(); if (page.shown) page.shown.draw(); };
addEventListener("resize", () => { Chart.resize(); if (page.shown) page.shown.draw(); });
element("theme").addEventListener("change", redraw);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
