"use strict";
// Least squares in the page: Levenberg's and Marquardt's method, and the preview of a fit that it makes of a recording.
// What takes long is a generator, which yields after each simulation: whoever runs it decides when the page has its turn.

const STEPS = 1500;                                      // of a simulation at most: a recording is thinned to them
const ENOUGH = 80;                                       // samples of a swing
const SWINGS = 4;                                        // on which a search begins
const RELEASE = 0.05;                                    // s: so far from its guess a release is looked for
const DRAWS = 240, KEPT = 3;                             // starts that are tried, and those that are followed

function dot(a, b) {
  let sum = 0;
  for (let n = 0; n < a.length; n++) sum += a[n] * b[n];
  return sum;
}

// A x = b of a few unknowns, by elimination.
function solved(A, b) {
  const n = b.length, M = A.map((row, i) => [...row, b[i]]);
  for (let k = 0; k < n; k++) {
    const p = M.slice(k).reduce((best, row, i) => (Math.abs(row[k]) > Math.abs(M[best][k]) ? k + i : best), k);
    [M[k], M[p]] = [M[p], M[k]];
    for (let i = k + 1; i < n; i++) {
      const share = M[i][k] / M[k][k];
      for (let c = k; c <= n; c++) M[i][c] -= share * M[k][c];
    }
  }
  const x = new Array(n).fill(0);
  for (let i = n - 1; i >= 0; i--) x[i] = (M[i][n] - x.reduce((sum, v, c) => sum + (c > i ? v * M[i][c] : 0), 0)) / M[i][i];
  return x;
}

const DIFFERENCES = [1e-4, 1e-3];                        // of an unknown's width: dry friction is bent between samples

// The least of the squares of errors(x), a Float64Array or null, from x on.  Of each unknown its bounds and its width.  Where
// a step gains less than the part `enough`, longer differences are asked, then it ends.  Yields after each simulation x
// where it became better, else null; → { x, r, cost }, r null where nothing can be simulated.
function* leastSquares(unknowns, x, errors, most = 60, enough = 1e-4) {
  const inside = y => y.map((v, k) => Math.min(Math.max(v, unknowns[k].lower), unknowns[k].upper));
  x = inside(x);
  let r = errors(x), cost = r ? dot(r, r) : Infinity, damping = 1e-3, scale = 0;
  for (let iteration = 0; r && iteration < most; iteration++) {
    const J = [];
    for (let k = 0; k < x.length; k++) {
      if (unknowns[k].held) { J.push(null); continue; }
      const { width, upper } = unknowns[k], part = DIFFERENCES[scale] * width, d = x[k] + part > upper ? -part : part;
      const moved = errors(x.map((v, j) => (j === k ? v + d : v)));
      J.push(moved ? moved.map((v, n) => (v - r[n]) / d) : r.map(() => 0));
      yield null;
    }
    const g = J.map(a => (a ? -dot(a, r) : 0));          // what is at a bound and would leave it stays there
    const free = x.map((_, k) => k).filter(k => J[k] && !(x[k] <= unknowns[k].lower && g[k] < 0) && !(x[k] >= unknowns[k].upper && g[k] > 0));
    const A = J.map(a => J.map(b => (a && b ? dot(a, b) : 0)));
    let lower = false, found = cost;
    for (let trial = 0; trial < 8 && !lower; trial++) {
      const tried = inside(stepped(A, g, x, free, damping, inside)), there = errors(tried);
      found = there ? dot(there, there) : Infinity;
      lower = found < cost;
      damping *= lower ? 0.2 : 8;
      if (lower) [x, r] = [tried, there];
      yield lower ? x : null;
    }
    const gain = cost - found;
    if (lower) cost = found;
    if (lower && gain >= enough * (cost + gain)) continue;
    if (++scale === DIFFERENCES.length) break;
    damping = 1e-3;
  }
  return { x, r, cost };
}

// Marquardt's step: what it would carry over a bound ends there, and the others continue with that.
function stepped(A, g, x, free, damping, inside) {
  const y = Array.from(x);
  for (let left = free; left.length;) {
    const ahead = left.map(k => g[k] - y.reduce((sum, v, j) => sum + (left.includes(j) ? 0 : A[k][j] * (v - x[j])), 0));
    const move = solved(left.map(i => left.map(j => (i === j ? A[i][i] * (1 + damping) || 1 : A[i][j]))), ahead);
    const there = x.map((v, k) => (left.includes(k) ? v + move[left.indexOf(k)] : v)), kept = inside(there), over = left.filter(k => kept[k] !== there[k]);
    for (const k of over.length ? over : left) y[k] = kept[k];
    left = over.length ? left.filter(k => !over.includes(k)) : [];
  }
  return y;
}

// Outputs that are functions of the states, of each state that a run holds: a row each.
function besides(measures, run, width, parameters, r) {
  const h = measures(parameters), count = r.outputs, K = r.inputs.length / r.width, out = new Float64Array(run.samples * count);
  for (let n = 0; n < run.samples; n++) {
    const k = Math.min(n * r.every, K - 1);
    h(run.states.subarray(n * width, (n + 1) * width), r.inputs.subarray(k * r.width, (k + 1) * r.width), out.subarray(n * count, (n + 1) * count));
  }
  return out;
}

// A run that begins at the release, between two samples: read at the samples as Trajectory.at does, through the four
// nearest steps; before the release it has its first value.
function released(program, outputs, r, run, orders) {
  const width = program.states.length, last = run.samples - 1, nodes = Math.min(4, run.samples), { states } = run;
  const ended = Math.floor((r.release + last * r.step) / (r.step * r.every) * (1 + 1e-12)) + 1; // of a run that diverges at once, before the first
  const samples = Math.max(1, Math.min(r.samples, ended)), read = new Float64Array(samples * width);
  for (const { state } of outputs) {
    const named = program.orders[state], q = typeof named === "string" ? orders[named] : named;
    const bent = Math.abs(q - 1) > 0.05 && q > 1e-12, powers = [0, 1, q, 1 + q].slice(0, nodes);
    const at = k => states[k * width + state];
    for (let n = 0; n < samples; n++) {
      const place = n * r.every - r.release / r.step;
      if (place <= 0) { read[n * width + state] = at(0); continue; }
      const first = Math.min(Math.max(Math.ceil(place) - 2, 0), run.samples - nodes);
      let y = 0;
      if (bent && first < 8) {
        const end = first + nodes - 1, basis = Array.from({ length: nodes }, (_, k) => powers.map(p => ((first + k) / end) ** p));
        y = dot(solved(basis, Array.from({ length: nodes }, (_, k) => at(first + k))), powers.map(p => (place / end) ** p));
      } else {
        for (let k = 0; k < nodes; k++) {
          let weight = 1;
          for (let other = 0; other < nodes; other++) if (other !== k) weight *= (place - first - other) / (k - other);
          y += weight * at(first + k);
        }
      }
      read[n * width + state] = y;
    }
  }
  return { states: read, samples };
}

const Preview = (() => {
  // --- a recording as a simulation takes it

  // Of a column the values [SI] where they and the time are finite, between them on lines.
  function onGrid(t, y, from, step, count) {
    const out = new Float64Array(count), finite = [];
    for (let n = 0; n < t.length; n++) if (Number.isFinite(y[n])) finite.push(n);
    if (!finite.length) return out.fill(NaN);
    let k = 0;
    for (let n = 0; n < count; n++) {
      const at = from + n * step;
      while (k < finite.length - 2 && t[finite[k + 1]] <= at) k++;
      const a = finite[k], b = finite[Math.min(k + 1, finite.length - 1)], share = b > a ? Math.min(Math.max((at - t[a]) / (t[b] - t[a]), 0), 1) : 0;
      out[n] = y[a] + share * (y[b] - y[a]);
    }
    return out;
  }

  // Rows whose time is later than all before; times in seconds from the first.
  function clock({ columns, rows }, { column, rate, factor }) {
    const kept = [], t = [], stamps = rate ? null : columns[column];
    let last = -Infinity;
    for (let n = 0; n < rows; n++) {
      const v = rate ? n / rate : stamps[n] * factor;
      if (!(v > last) || v === Infinity) continue;
      last = v;
      kept.push(n);
      t.push(v);
    }
    return { kept, t: Float64Array.from(t) };
  }

  const median = values => Float64Array.from(values).sort()[values.length >> 1];

  // One signal [SI] at the rows that the clock keeps.
  const signal = (table, { column, factor, zero }, kept) => Float64Array.from(kept, n => factor * table.columns[column][n] - (zero || 0));

  // signals: output or input → { column, factor, zero }; null where there is too little of it.
  function recordingOf(table, spec, { time, signals, from, to, held = false, limit = 1e4 }) {
    const { kept, t } = clock(table, time);
    if (t.length < 3) return null;
    const first = Math.max(from ?? t[0], t[0]), last = Math.min(to ?? t.at(-1), t.at(-1)), gap = median(t.slice(1).map((v, n) => v - t[n]));
    const whole = Math.floor((last - first) / gap * (1 + 1e-9)) + 1;
    if (!(whole >= 20) || whole > 1e9) return null;
    const shown = spec.outputs.filter(o => signals[o.name]), atLeast = Math.ceil((whole - 1) / STEPS);
    const on = (name, every) => onGrid(t, signal(table, signals[name], kept), first, every * gap, Math.floor((whole - 1) / every) + 1);
    const swing = atLeast * period(shown.map(o => on(o.name, atLeast))), thin = Math.max(atLeast, Math.floor(Math.min(swing / ENOUGH, whole / 400)));
    const step = thin * gap, samples = Math.floor((whole - 1) / thin) + 1, of = name => on(name, thin), measured = shown.map(o => of(o.name));
    const width = Math.max(1, spec.inputs.length), inputs = new Float64Array(width * samples);
    let driven = false;
    spec.inputs.forEach(({ name, value, rateOf }, c) => {
      const given = signals[name] || signals[rateOf], u = given && of(signals[name] ? name : rateOf), slope = n => (u[Math.min(n + 1, samples - 1)] - u[Math.max(n - 1, 0)]) / ((Math.min(n + 1, samples - 1) - Math.max(n - 1, 0)) * step);
      for (let n = 0; n < samples; n++) inputs[n * width + c] = !u ? value : signals[name] ? u[n] || 0 : slope(n) || 0;
      driven ||= !!u && u.some(v => v !== u[0]);
    });
    const range = measured.map(y => y.reduce((m, v) => Math.max(m, v), -Infinity) - y.reduce((m, v) => Math.min(m, v), Infinity));
    if (!measured.length || !range.every(v => v > 0 && Number.isFinite(v))) return null;
    const largest = Math.max(1, ...measured.map(y => y.reduce((m, v) => Math.max(m, Math.abs(v)), 0)));
    const reach = held ? Math.max(RELEASE, 5 * step) : 0;
    return { step, steps: samples - 1 + Math.ceil(reach / step), every: 1, samples, whole, thin, from: first, inputs: driven ? inputs : inputs.subarray(0, width), width, reach, outputs: spec.outputs.length, shown, measured, range, driven, held, limit: limit * largest, period: period(measured) };
  }

  // Samples of a swing: of the output that crosses its middle most often, twice the mean time between; all without one.
  function period(measured) {
    const counts = measured.map(y => {
      const middle = y.subarray(y.length >> 1).reduce((sum, v) => sum + v, 0) / (y.length - (y.length >> 1)), room = 0.05 * y.reduce((m, v) => Math.max(m, Math.abs(v - middle)), 0);
      let side = 0, count = 0;
      for (const v of y) {
        if (Math.abs(v - middle) < room) continue;
        if (side && side !== Math.sign(v - middle)) count++;
        side = Math.sign(v - middle);
      }
      let last = y.length - 1;
      while (last > 0 && Math.abs(y[last] - middle) < room) last--;
      return count > 2 ? 2 * last / count : y.length;
    });
    return Math.min(...counts);
  }

  // --- what is sought

  // Of each unknown its kind, name, start, bounds and width.
  function unknownsOf(spec, r, { parameters, free, fixedOrders = {} }) {
    const orders = spec.orders.filter(q => !(q.name in fixedOrders)).map(q => ({ kind: "orders", name: q.name, start: q.start, lower: q.low, upper: q.high, width: 0.1 }));
    const constants = spec.parameters.filter(p => free.has(p.name)).map(p => {
      const value = parameters[p.name], size = Math.abs(value) || p.size, [lower, upper] = boundsOf(p, value);
      return { kind: "parameters", name: p.name, start: value, lower, upper, width: size, late: p.lowest !== undefined };
    });
    const initial = spec.initial.filter(({ output }) => !r.held || output).map(({ state, output, unit }) => {
      const own = r.shown.findIndex(o => o.name === output), k = own < 0 ? r.shown.findLastIndex(o => o.unit === unit) : own;
      const range = Math.max(...r.range), first = k < 0 ? 0 : r.measured[k][0], size = k < 0 ? range * 2 * Math.PI / (r.period * r.step) : r.range[k];
      return { kind: "initial", name: state, start: first, lower: -Infinity, upper: Infinity, width: size, near: own < 0 && k >= 0 ? reach(r.measured[k]) : null };
    });
    const release = r.held ? [{ kind: "release", name: "release", start: 0, lower: -r.reach, upper: r.reach, width: r.step }] : [];
    return [...orders, ...constants, ...initial, ...release];
  }

  // How far the values and 0 are apart.
  const reach = y => y.reduce((most, v) => Math.max(most, v), 0) - y.reduce((least, v) => Math.min(least, v), 0);

  // Between what a constant is sought: what has a sign keeps it.
  function boundsOf(p, value) {
    const size = Math.abs(value) || p.size;
    if (p.lowest !== undefined) return [p.lowest, p.highest];
    if (p.friction) return [Math.max(0, p.lower ?? 0), Math.min(100 * size, p.upper ?? Infinity)];
    if (value === 0 || p.signed) return [Math.max(-100 * size, p.lower ?? -Infinity), Math.min(100 * size, p.upper ?? Infinity)];
    const ends = [value / p.span, value * p.span].sort((a, b) => a - b);
    return [Math.max(ends[0], p.lower ?? -Infinity), Math.min(ends[1], p.upper ?? Infinity)];
  }

  function valuesOf(spec, unknowns, x, { parameters, fixedOrders = {} }) {
    const values = { orders: Object.fromEntries(spec.orders.map(q => [q.name, fixedOrders[q.name] ?? q.start])), parameters: { ...parameters }, initial: new Array(spec.program.states.length).fill(0), release: null };
    unknowns.forEach(({ kind, name }, k) => { if (kind === "release") values.release = x[k]; else values[kind][name] = x[k]; });
    return values;
  }

  function simulated(spec, r, values, samples = r.samples) {
    const steps = samples + r.steps - r.samples, run = Fracid.simulate(spec.program, { ...r, steps, initial: values.initial, jumps: null, memory: r.steps }, values, spec.model);
    if (run.completed && values.release !== null) Object.assign(run, released(spec.program, r.shown, { ...r, release: values.release, samples }, run, values.orders));
    if (spec.measures && run.completed) run.besides = besides(spec.measures, run, spec.program.states.length, values.parameters, r);
    return run;
  }

  // Measured less simulated, an output behind the other, each over its level; null where the run ends early.
  function errorsOf(spec, r, values, levels, samples = r.samples) {
    const run = simulated(spec, r, values, samples), width = spec.program.states.length, count = spec.outputs.length;
    if (!run.completed) return null;
    const errors = new Float64Array(r.shown.length * samples);
    r.shown.forEach(({ place, state }, k) => {
      for (let n = 0; n < samples; n++) errors[k * samples + n] = (r.measured[k][n] - (state === null ? run.besides[n * count + place] : run.states[n * width + state])) / levels[k] || 0;
    });
    return errors.every(Number.isFinite) ? errors : null;
  }

  // A sequence that is the same on every machine (a linear congruence of 31 bits).
  const draws = () => {
    let seed = 20260101;
    return () => (seed = Number((BigInt(seed) * 48271n) % 2147483647n)) / 2147483647;
  };

  // One start drawn about another: constants by their logarithm, frictions over decades.
  const drawn = (unknowns, random) => unknowns.map(({ kind, start, lower, upper, width, late }) => {
    const u = random();
    if (kind !== "parameters" || late) return start;
    if (lower > 0) return Math.exp(Math.log(lower) + u * Math.log(upper / lower));
    if (upper < 0) return -Math.exp(Math.log(-upper) + u * Math.log(lower / upper));
    return start < 0 ? (2 * u - 1) * width : width * 10 ** (3 * u - 2);
  });

  // The fit: from the best of many starts on a few swings to all of it.  Yields { said, x } after each simulation.
  function* fit(spec, r, setup) {
    const unknowns = unknownsOf(spec, r, setup), alike = new Set(r.shown.map(o => o.unit)).size < 2;
    let levels = alike ? r.shown.map(() => Math.max(...r.range)) : r.range;
    const errors = samples => x => errorsOf(spec, r, valuesOf(spec, unknowns, x, setup), levels, samples);
    const few = Math.min(r.samples, Math.max(40, Math.ceil(SWINGS * r.period)));
    const random = draws(), tried = [];
    for (let k = 0; k < DRAWS; k++) {
      const x = k === 0 ? unknowns.map(u => u.start) : drawn(unknowns, random), e = errors(few)(x);
      if (e) tried.push({ x, cost: dot(e, e) });
      yield { said: "looking for a start", x: null };
    }
    const own = tried.slice(0, 1);                       // a rig of the library may be this one
    tried.sort((a, b) => a.cost - b.cost);
    let best = { x: unknowns.map(u => u.start), cost: Infinity, r: null };
    const follow = function* (x, samples, most, said, enough) { // how sharp dry friction is, the whole recording tells
      const search = leastSquares(unknowns.map(u => ({ ...u, held: u.late && samples < r.samples })), x, errors(samples), most, enough);
      for (;;) {
        const step = search.next();
        if (step.done) return step.value;
        yield { said, x: step.value };
      }
    };
    for (const start of new Set([...own, ...tried.slice(0, KEPT)])) {
      const found = yield* follow(start.x, few, 12, "fitting the first swings", 1e-2);
      if (found.cost < best.cost) best = found;
    }
    for (const samples of [...new Set([few, Math.min(r.samples, 4 * few), r.samples])]) best = yield* follow(best.x, samples, 60, "fitting", samples < r.samples ? 1e-3 : 1e-6);
    if (!alike && best.r) {                              // units apart: each output counts by its residual
      levels = r.shown.map((_, k) => rms(best.r.subarray(k * r.samples, (k + 1) * r.samples)) * levels[k] || levels[k]);
      best = yield* follow(best.x, r.samples, 40, "fitting", 1e-6);
    }
    const errorsNow = best.r && r.shown.map((_, k) => rms(best.r.subarray(k * r.samples, (k + 1) * r.samples)) * levels[k]);
    return { unknowns, x: best.x, rmse: errorsNow, values: valuesOf(spec, unknowns, best.x, setup), levels };
  }

  const rms = values => Math.sqrt(dot(values, values) / values.length);

  return { recordingOf, unknownsOf, boundsOf, valuesOf, simulated, fit, clock, signal, median };
})();
