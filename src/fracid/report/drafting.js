"use strict";
// What a table may be, and the project of it: columns by their names and how they move, in the words of fracid init.

const Drafting = (() => {
  const RATE = /dot|veloc|speed|rate|^d_|deriv|accel|^q?dq?d|^qd|stamp|offset|temp|^v_?\d*$/;
  const TIME = /(^|[^a-z])(t|time|timestamp|stamp|elapsed|seconds?|secs?|zeit)([^a-z]|$)/;
  const NAMELESS = /^(col(umn)?|ch(annel)?|sig(nal)?|data|var|val(ue)?|sensor|adc|enc(oder)?|[a-z])?[ _:.-]*\d*$/;
  const FALLING = [0.02, 0.15];                          // of the way to the fastest motion
  const JITTER = 0.02, FEW = 20000;                      // of half of the steps, of the step: they are no grid; in so few samples
  const JUMP = 0.125, EVEN = 10, MOST = 0.5;             // of the range, of its neighbours, of all squares: a step that is a jump
  const TURN = 2 * Math.PI, DEGREE = Math.PI / 180;

  const bare = name => name.toLowerCase().replace(/\s*[[(].*$/, "").trim();
  const ends = y => y.reduce(([low, high], v) => (v < low ? [v, high] : v > high ? [low, v] : [low, high]), [Infinity, -Infinity]);
  const spread = y => { const [low, high] = ends(y); return high > low ? high - low : 0; };

  // --- columns

  // Signal → the column that is called like it, of one model.
  function rolesOf(spec, names) {
    const roles = {}, taken = new Set();
    for (const [signal, pattern] of Object.entries(spec.columns)) {
      const like = new RegExp(pattern), others = Object.entries(spec.columns).filter(([s]) => s !== signal).map(([, p]) => new RegExp(p));
      const free = names.map((name, c) => ({ c, name: bare(name) })).filter(({ c }) => !taken.has(c));
      const exact = free.filter(({ name }) => name === signal), matches = exact.length ? exact : free.filter(({ name }) => like.test(name) && !RATE.test(name));
      const found = matches.sort((a, b) => others.filter(p => p.test(a.name)).length - others.filter(p => p.test(b.name)).length)[0];
      if (found) { roles[signal] = found.c; taken.add(found.c); }
    }
    return roles;
  }

  // The model that has places for most columns; the one with fewest constants, should several.
  function modelOf(specs, names) {
    const found = Object.entries(specs).map(([name, spec]) => ({ name, roles: rolesOf(spec, names) }))
      .filter(({ name, roles }) => specs[name].needs.every(s => s in roles) && specs[name].outputs.some(o => o.name in roles));
    return found.sort((a, b) => Object.keys(b.roles).length - Object.keys(a.roles).length || specs[a.name].parameters.length - specs[b.name].parameters.length)[0] || null;
  }

  // The column of time, its unit, or the rate where there is none.
  function timeOf(table, units) {
    const rising = table.columns.map(y => { let last = -Infinity, up = 0; for (const v of y) { if (v > last) { up++; last = v; } } return up > 0.9 * table.rows && table.rows > 2; });
    const titled = table.names.findIndex((name, c) => rising[c] && TIME.test(name.toLowerCase().replace(/_/g, " "))), column = titled >= 0 ? titled : rising.indexOf(true);
    if (column < 0) return { column: null, unit: "s", rate: 100 };
    const suffix = table.names[column].toLowerCase().split(/[_ ]/).at(-1), unit = table.units[column] || suffix;
    return { column, unit: spelled(units.time, unit) || "s", rate: null };
  }

  const spelled = (units, word) => (Object.hasOwn(units, word) ? word : Object.keys(units).find(u => (units[u].also || []).includes(word)));

  // The unit of a column as a signal of this SI unit.
  function unitOf(table, column, of, units) {
    const ways = table.names[column].split("_"), isUnit = end => spelled(units.signal, end) && (end.length > 1 || end === end.toUpperCase());
    const suffix = ways.slice(1).map((_, k) => ways.slice(k + 1).join("_")).find((end, k) => isUnit(end) && ways[k] !== "per" && !(k > 0 && isUnit(ways[k])));
    const said = spelled(units.signal, table.units[column] || suffix || "");
    if (said && units.signal[said].of === of) return { unit: said, counts: 4096 };
    const y = table.columns[column].filter(Number.isFinite), range = spread(y);
    if (of === "rad" && range > 50 && y.every(Number.isInteger)) return { unit: "counts", counts: 4096 };
    if (of === "rad" && range > 4 * Math.PI && range < 2000) return { unit: "deg", counts: 4096 };
    return { unit: Object.hasOwn(units.signal, of) ? of : "1", counts: 4096 };
  }

  const factorOf = ({ unit, counts }, units) => (unit === "counts" ? TURN / counts : units.signal[unit].factor);

  // --- when it begins

  // When it is let go: the end of a plateau before the fastest motion, between two samples; null where it is not held.
  function releaseOf(t, y) {
    if (t.length < 20) return null;
    const step = (t.at(-1) - t[0]) / (t.length - 1), w = Math.max(1, Math.min(Math.round(0.01 / step), t.length >> 3));
    const speed = new Float64Array(t.length);
    for (let n = w; n < t.length - w; n++) speed[n] = Math.abs(y[n + w] - y[n - w]) / (t[n + w] - t[n - w]) || 0;
    const most = speed.reduce((a, v) => Math.max(a, v), 0);
    const fastest = speed.findIndex(v => v >= 0.95 * most);
    let last = fastest;
    while (last > w && speed[last] >= 0.05 * most) last--;
    if (last <= w) return null;
    const travel = Math.abs(y[fastest] - y[last]);
    let begin = last;
    while (begin > 0 && Math.abs(y[begin - 1] - y[last]) <= 0.08 * travel) begin--;
    if (t[last] - t[begin] < 0.2 * (t[fastest] - t[last])) return null;
    const level = y.subarray(begin, last + 1).reduce((sum, v) => sum + v, 0) / (last + 1 - begin), points = [];
    for (let n = last; n < fastest; n++) { // a free fall's rise is t², so its root is a line
      const rise = Math.abs(y[n] - level) / Math.abs(y[fastest] - level);
      if (rise > FALLING[0] && rise < FALLING[1]) points.push([t[n] - t[last], Math.sqrt(rise)]);
    }
    const [x, z] = [0, 1].map(k => points.reduce((sum, p) => sum + p[k], 0) / points.length), slope = points.reduce((sum, p) => sum + (p[0] - x) * (p[1] - z), 0) / points.reduce((sum, p) => sum + (p[0] - x) ** 2, 0);
    const moment = points.length > 2 && slope > 0 ? t[last] + x - z / slope : t[last];
    return Math.min(Math.max(moment, t[begin]), t[fastest]);
  }

  // Where it hangs: what a signal comes to rest at, if that is not near the zero of the file.
  function zeroOf(y) {
    const end = y.subarray(Math.floor(0.9 * y.length)).filter(Number.isFinite).sort(), whole = spread(y.filter(Number.isFinite));
    if (!end.length) return 0;
    const middle = end[end.length >> 1];
    return end.at(-1) - end[0] < 0.1 * whole && Math.abs(middle) > 2 * DEGREE ? Number(middle.toPrecision(6)) : 0;
  }

  // Everything that the page guesses of a table: what its reader may correct; null where no model has columns of these names.
  function guess(table, specs, units, wanted = null) {
    const time = timeOf(table, units), names = table.names.map((name, c) => (c === time.column ? "" : name)), found = wanted ? { name: wanted, roles: rolesOf(specs[wanted], names) } : modelOf(specs, names);
    const silent = names.every(n => NAMELESS.test(n.toLowerCase()));
    if (!found && !silent) return null;
    const model = found ? found.name : "rotary-pendulum", spec = specs[model], signals = {};
    let { roles = {} } = found || {};
    if (!spec.outputs.some(o => o.name in roles)) {      // by how they move
      const moving = table.columns.map((y, c) => ({ c, range: c === time.column ? 0 : spread(y) })).filter(({ range }) => range > 0).sort((a, b) => b.range - a.range);
      roles = Object.fromEntries([...spec.outputs].reverse().map((o, k) => [o.name, moving[k] && moving[k].c]).filter(([, c]) => c !== undefined));
    }
    for (const { name, unit } of [...spec.outputs, ...spec.inputs]) if (name in roles) signals[name] = { column: roles[name], zero: 0, ...unitOf(table, roles[name], unit, units) };
    const setup = { model, rig: spec.rigs ? spec.rigs[0].name : null, time, signals, from: null, to: null, held: false };
    begin(table, spec, units, setup);
    return setup;
  }

  // Zeros, release and end, of what the columns now are.
  function begin(table, spec, units, setup) {
    const { time, signals } = setup, { kept, t } = Preview.clock(table, { column: time.column, rate: time.rate, factor: units.time[time.unit].factor });
    Object.assign(setup, { from: null, to: null, held: false });
    if (t.length < 3) return;
    const of = name => Preview.signal(table, { ...signals[name], factor: factorOf(signals[name], units), zero: 0 }, kept), swings = spec.swings in signals ? spec.swings : spec.outputs.map(o => o.name).find(n => n in signals);
    for (const { name, unit } of spec.outputs) if (spec.swings && name in signals) signals[name].zero = unit === "rad" ? zeroOf(of(name)) : 0;
    const driven = spec.inputs.some(({ name }) => name in signals && spread(of(name)) > 0), release = driven || !spec.swings || !swings ? null : releaseOf(t, of(swings));
    setup.from = Number((release ?? t[0]).toPrecision(6));
    setup.to = Number(t.at(-1).toPrecision(12));
    setup.held = release !== null && spec.outputs.every(o => o.state !== null || !(o.name in signals));
  }

  // --- between its samples

  // Whether a signal goes by jumps, as a test stand's steps and pulses do.
  function jumps(t, x) {
    const dt = t.slice(1).map((v, n) => v - t[n]), step = Preview.median(dt), steps = dt.map((d, n) => (Math.abs(x[n + 1] - x[n]) / d) * step), range = spread(x);
    const squares = of => steps.reduce((sum, s, n) => (of(s, n) ? sum + s * s : sum), 0), beside = n => Math.max(steps[n - 1], steps[n + 1]);
    return squares((s, n) => n > 0 && n < steps.length - 1 && s > Math.max(JUMP * range, EVEN * beside(n))) > MOST * squares(() => true);
  }

  // What each input that moves does: volts and what goes by jumps keep their value; one whose rate the model takes goes in lines.
  function betweenOf(table, spec, units, { time, signals }) {
    const { kept, t } = Preview.clock(table, { column: time.column, rate: time.rate, factor: units.time[time.unit].factor }), rated = spec.inputs.map(({ rateOf }) => rateOf);
    const values = name => Preview.signal(table, { ...signals[name], factor: factorOf(signals[name], units) }, kept), volts = name => units.signal[signals[name].unit].of === "V";
    const moving = spec.inputs.map(({ name }) => name).filter(name => name in signals && !rated.includes(name) && spread(values(name)) > 0);
    return Object.fromEntries(moving.map(name => [name, volts(name) || jumps(t, values(name)) ? "hold" : "line"]));
  }

  // Whether stamps are no grid, so that straight lines between samples are not the motion.
  function jitters(table, units, { time, from, to }) {
    const { t } = Preview.clock(table, { column: time.column, rate: time.rate, factor: units.time[time.unit].factor }), part = t.filter(v => v >= from && v <= to);
    const dt = part.slice(1).map((v, n) => v - part[n]), step = Preview.median(dt);
    return dt.length > 0 && dt.length < FEW && Preview.median(dt.map(d => Math.abs(d - step))) > JITTER * step;
  }

  // --- the project

  const BETWEEN = {
    hold: 'each value holds until the next sample; "line" if it goes straight to the next',
    line: 'it goes straight from sample to sample; "hold" if each value holds until the next',
  };
  const text = words => JSON.stringify(String(words).replace(/[\ud800-\udbff](?![\udc00-\udfff])|(?<![\ud800-\udbff])[\udc00-\udfff]/g, "\ufffd")).replace(/\x7f/g, "\\u007f");
  const number = (v, digits = 6) => {
    const short = String(Number.isFinite(v) ? Number(v.toPrecision(digits)) : 0);
    return /[.e]/.test(short) ? short : `${short}.0`;
  };
  const comment = words => words.replace(/[\x00-\x1f\x7f\ud800-\udfff]/g, " ");
  const line = (key, value, why = "") => (why ? `${`${key} = ${value}`.padEnd(39)} # ${comment(why)}` : `${key} = ${value}`);
  const range = (name, start, lower, upper, why) => `${`${name} = { start = ${number(start)}, lower = ${number(lower, 3)}, upper = ${number(upper, 3)} }`.padEnd(69)} # ${comment(why)}`;
  const key = name => (/^[A-Za-z0-9_-]+$/.test(name) ? name : text(name));

  // A column by its name where that is one word of the table, else by its place.
  const columnOf = ({ names }, c) => (/^[\w/.:-]*[a-zA-Z_][\w/.:-]*$/.test(names[c]) && names.indexOf(names[c]) === names.lastIndexOf(names[c]) ? text(names[c]) : c);

  // Down and up to three digits, so that the start stays between.
  const around = (start, lower, upper) => [Math.min(start, Number(lower.toPrecision(3))), Math.max(start, Number(upper.toPrecision(3)))].map(Number);

  function project(table, spec, setup, { values, free, fixedOrders, rmse, units, unknowns = [] }) {
    const { time, signals } = setup, between = betweenOf(table, spec, units, setup), near = unknowns.filter(u => u.near), windowed = spec.rigs && Object.keys(between).length > 0, shown = spec.outputs.filter(o => o.name in signals), stem = table.name.replace(/\.[^.]*$/, "").slice(0, 60) || "recording";
    const parts = [[
      `# Drafted in a browser, a preview: ${comment(rmse)}; no interval, no claim.`, "#", "# Look at every line, then:   fracid fit THIS-FILE",
    ], [
      "[model]", line("name", text(setup.model), spec.about), ...(setup.rig ? [line("rig", text(setup.rig), "initial constants")] : []),
      ...(spec.zero ? [line("zero", text(spec.zero), "where the angle of the pendulum is 0: hanging or upright")] : []),
    ], ["[model.parameters]                      # SI; a number fixes, a table frees", ...spec.parameters.flatMap(p => {
      const v = values.parameters[p.name], why = `${p.about} [${p.unit}]`;
      if (!free.has(p.name)) return p.gauge || p.free === "always" ? [line(p.name, number(v), why)] : [];
      if (p.rest && p.unit === "rad") return [];           // each recording has its own, within a radian
      const size = Math.max(Math.abs(v), p.size), [low, high] = p.lowest !== undefined ? [p.lowest, p.highest] : p.friction || p.lower === 0 ? [0, 10 * size] : p.value === 0 || v === 0 || p.signed ? [-10 * size, 10 * size] : v > 0 ? [v / p.span, v * p.span] : [v * p.span, v / p.span];
      const [lower, upper] = around(Number(v.toPrecision(6)), Math.max(low, p.lower ?? -Infinity), Math.min(high, p.upper ?? Infinity));
      return [range(p.name, v, lower, upper, why)];
    })], ["[model.orders]                          # 1.0 is the integer-order model", ...spec.orders.map(q => (q.name in fixedOrders
      ? line(q.name, number(fixedOrders[q.name]), "nothing shows it") : range(q.name, values.orders[q.name], Math.min(q.low, values.orders[q.name]), Math.max(q.high, values.orders[q.name]), "order")))],
    [
      "[[recording]]", line("name", text(stem)), line("file", text(table.name), "beside this file, or the path to it"),
      ...(table.variable ? [line("variable", text(table.variable))] : []),
      line("time", time.rate ? `{ rate = ${number(time.rate, 12)} }` : `{ column = ${columnOf(table, time.column)}, unit = ${text(time.unit)} }`),
      ...Object.entries(signals).map(([name, s]) => line(key(name), `{ column = ${columnOf(table, s.column)}, unit = ${text(s.unit)}${s.unit === "counts" ? `, counts_per_turn = ${s.counts}` : ""}${s.zero ? `, zero = ${number(s.zero)}` : ""}${between[name] ? `, between = ${text(between[name])}` : ""} }`, BETWEEN[between[name]])),
      ...(near.length ? [line("initial", `{ ${near.map(u => `${spec.program.states[u.name]} = { start = ${number(values.initial[u.name])}, lower = ${number(Math.min(u.start, values.initial[u.name]) - u.near, 4)}, upper = ${number(Math.max(u.start, values.initial[u.name]) + u.near, 4)} }`).join(", ")} }`, "estimated too: nothing measures it directly")] : []),
      ...(jitters(table, units, setup) && !windowed ? [line("resample", text("uneven"), "samples stay where they are: straight lines between them are not the motion")] : []),
      ...(setup.held ? [line("from", text("release"), `found at ${number(setup.from, 5)} s`), line("release_time", `{ start = 0.0, lower = ${-RELEASE}, upper = ${RELEASE} }`, "[s] of the release after that sample; it lies between two")] : [line("from", number(setup.from, 12), "[s]")]),
      line("to", number(setup.to, 12), "[s]"), line("use", text("fit"), 'or "validate": held out for validation'),
    ], [
      "[fit]", line("outputs", `[${shown.map(o => text(o.name)).join(", ")}]`), ...(setup.held ? [line("initial_state", text("rest"), "held before the release; estimate, if the hand moved it")] : []),
      ...(new Set(shown.map(o => o.unit)).size > 1 ? [line("weights", text("noise"), "outputs of different units count by their noise")] : []),
      ...(spec.parameters.some(p => p.rest && free.has(p.name)) ? [line("per_recording", `[${spec.parameters.filter(p => p.rest && free.has(p.name)).map(p => text(p.name)).join(", ")}]`, "where it rests differs from recording to recording")] : []),
    ]];
    return `${parts.filter(part => part.length > 1).map(part => part.join("\n")).join("\n\n")}\n`;
  }

  return { guess, begin, factorOf, spread, project, rolesOf };
})();
