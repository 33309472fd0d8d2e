"use strict";
// fracid's solver in plain JavaScript: D^q x = f(x, u), q between 0 and 2, by the same schemes, memory and start as
// fracid.solver, to rounding.  Names and formulas are those of its modules, which derive them.
//
//   Fracid.solve(f, { orders, gain, initial, step, steps, every, tolerance, limit, inputs, jumps, width, relaxing,
//                     family, newton, raw, lastFirst })
//
//   f(x, u, out)      fills out with D^q x, and behind it, of states that relax, the rate with which they forget
//   gain              h^q τ^(1−q) of each state
//   inputs            Float64Array, `width` numbers a step just before it, or once for all; jumps: just after it, or null
//   memory            steps that the tables hold at least: runs of several lengths share those of the longest
//   → { states, samples, completed }, a row of states for every so many steps
//
// family "pi" is pi2, with Newton's method at every step if `newton`; "gl" is gl, gl-sequential if `lastFirst`, and
// gl-paper if `raw`.

const Fracid = (() => {
  const { abs, exp, expm1, log, log1p, max, min, pow, PI, sin, sinh, sqrt, ceil, round } = Math;

  // --- special functions ---------------------------------------------------------------------------

  // Lanczos's approximation with g = 607/128, to 1e-15.
  const LANCZOS = [0.99999999999999709182, 57.156235665862923517, -59.597960355475491248, 14.136097974741747174,
    -0.49191381609762019978, 3.3994649984811888699e-5, 4.6523628927048575665e-5, -9.8374475304879564677e-5,
    1.5808870322491248884e-4, -2.1026444172410488319e-4, 2.174396181152126432e-4, -1.6431810653676389022e-4,
    8.4418223983852743293e-5, -2.6190838401581408670e-5, 3.6899182659531622704e-6];

  function logGamma(x) {                                 // log |Γ(x)|, x > 0
    let sum = LANCZOS[0];
    for (let k = 1; k < 15; k++) sum += LANCZOS[k] / (x - 1 + k);
    const t = x - 0.5 + 607 / 128;
    return (x - 0.5) * log(t) - t + log(sqrt(2 * PI) * sum);
  }

  function gamma(x) {
    if (x < 0.5) return gamma(x + 1) / x;
    if (x > 1.5) return (x - 1) * gamma(x - 1);          // the approximation is best near 1
    return exp(logGamma(x));
  }

  function inverseGamma(x) {                             // 0 at 0, −1, −2, …
    let factor = 1;
    for (; x < 0.5; x++) factor *= x;
    return factor / gamma(x);
  }

  function sineRatio(a) {                                // sin(πa)/π, exact next to whole numbers
    const whole = round(a);
    return (whole % 2 === 0 ? 1 : -1) * sin(PI * (a - whole)) / PI;
  }

  function zeta(s) {                                     // Riemann's, s < 0, by Euler and Maclaurin from the 12th term on
    const N = 12, bernoulli = [1 / 6, -1 / 30, 1 / 42, -1 / 30, 5 / 66];
    let total = pow(N, 1 - s) / (s - 1) + pow(N, -s) / 2, term = s * pow(N, -s - 1) / 2;
    for (let k = 1; k < N; k++) total += pow(k, -s);
    bernoulli.forEach((b, j) => {
      total += b * term;
      term *= (s + 2 * j + 1) * (s + 2 * j + 2) / (N * N * (2 * j + 3) * (2 * j + 4));
    });
    return total;
  }

  // --- weights: fracid.solver.weights ----------------------------------------------------------------

  function trapezoidalWeights(q, steps) {
    const b = new Float64Array(steps + 1), a = new Float64Array(steps + 1), binomial = new Float64Array(20).fill(1);
    b[0] = 1;
    for (let k = 1; k < min(8, steps + 1); k++) {
      const up = expm1(q * log1p(1 / k)), down = expm1(q * log1p(-1 / k));
      b[k] = pow(k, q) * ((k + 1) * up + (k === 1 ? 0 : (k - 1) * down));
      a[k] = pow(k, q) * ((k === 1 ? 0 : (k - 1) * down) + q);
    }
    for (let j = 0; j < 19; j++) binomial[j + 1] = binomial[j] * (q - (j - 1)) / (j + 1);
    for (let k = 8; k <= steps; k++) {
      let even = 0, odd = 0;
      for (let j = 18; j > 1; j -= 2) {
        even = even / k / k + binomial[j];
        odd = odd / k / k + binomial[j + 1];
      }
      b[k] = 2 * pow(k, q - 1) * even;
      a[k] = pow(k, q - 1) * (even - odd / k);
    }
    const g = gamma(q + 2);
    return [b.map(v => v / g), a.map(v => v / g)];
  }

  // --- the compressed memory: fracid.solver.exponentials ----------------------------------------------

  const LAGS = 8, LOW_NODES = 5, SHARES = { spacing: 0.78, upper: 0.1, lower: 0.1 };

  function littleJacobi(b, spacing) {
    const n = LOW_NODES, Q = exp(-spacing), A = exp(-spacing * b);
    let norm = pow(A, n) * pow(Q, n * (n - 1)) / (1 - A * pow(Q, 2 * n));
    for (let k = 0; k < n; k++) norm *= pow((1 - pow(Q, k + 1)) / (1 - A * pow(Q, n + k)), 2);
    return norm;
  }

  function nextRoot(c, roots) {
    let x = 1.1;
    for (let iteration = 0; iteration < 60; iteration++) {
      let value = 0, derivative = 0;
      for (let k = c.length - 1; k >= 0; k--) {
        derivative = derivative * x + value;
        value = value * x + c[k];
      }
      for (const root of roots) derivative -= value / (x - root);
      const change = value / derivative;
      x -= change;
      if (abs(change) <= 4e-16 * x) break;
    }
    return x;
  }

  function lowEnd(a, sine, spacing, double, s, omega) {
    const n = LOW_NODES, p = double ? 2 : 1, Q = exp(-spacing), A = exp(-spacing * (a + p)), M = [], c = [1];
    for (let k = 0; k < n + 2; k++) M.push(-sine * spacing / expm1(-spacing * (a + k)));
    for (let k = 0; k < n; k++)
      c.push(c[k] * Q * (1 - pow(Q, k - n)) * (1 - A * pow(Q, n + k)) / ((1 - A * pow(Q, k)) * (1 - pow(Q, k + 1))));
    omega[0] = M[0];
    let slope = double ? M[1] : 0;
    for (let i = 1; i <= n; i++) {
      s[i] = nextRoot(c, s.subarray(1, i));
      let quotient = 0, mass = 0, value = 0;
      for (let k = n - 1; k >= 0; k--) {
        quotient = c[k + 1] + quotient * s[i];
        mass += quotient * M[p + k];
        value += quotient * pow(s[i], k);
      }
      omega[i] = mass / value / pow(s[i], p);
      omega[0] -= omega[i];
      if (double) slope -= omega[i] * s[i];
    }
    return slope;
  }

  // (sin πa/π) ∫ s^(a−1) F(s) ds = Σ ω F(s) + slope F'(0), for F(s) = g(s) e^(−st), t from first to steps.
  function quadrature(a, sine, first, steps, tolerance, double) {
    const inner = LOW_NODES, factorial = a < 0 ? exp(logGamma(a + 1)) / -a : exp(logGamma(a));
    let y = 10;
    const scale = log(2 * sqrt(2 * PI) / (SHARES.spacing * tolerance)) - log(factorial);
    for (let k = 0; k < 6; k++) y = max(3, (scale + (a - 0.5) * log(y)) * 2 / PI);
    const spacing = 2 * PI / y, remainder = 0.3 * (1 + abs(a)) * pow(expm1(spacing), 2);
    const weight = SHARES.upper * tolerance * factorial / (spacing * remainder);
    let end = 20;
    for (let k = 0; k < 6; k++) end = max(3, a * log(end) - log(weight));
    end /= first;
    const p = double ? 2 : 1, r = 2 * inner + p;
    const power = SHARES.lower * tolerance * factorial * gamma(r + 1) / (spacing * littleJacobi(a + p, spacing));
    const low = min(exp(log(power) / (a + r)) / steps, end * exp(-4 * spacing));
    const count = ceil(log(end / low) / spacing - 1e-9) - 1;
    const s = new Float64Array(1 + inner + count), omega = new Float64Array(1 + inner + count);
    const slope = lowEnd(a, sine, spacing, double, s, omega);
    for (let m = 0; m <= inner; m++) {
      s[m] *= low;
      omega[m] *= pow(low, a);
    }
    for (let m = 1 + inner; m < s.length; m++) {
      s[m] = low * exp(spacing * (m - inner));
      omega[m] = sine * spacing * pow(s[m], a);
    }
    const last = s[s.length - 1];                        // it stands for all beyond it
    let mass = 0, mean = 0;
    for (let j = 0; j < 5; j++) {
      const node = last * exp(spacing * j), share = pow(node, a) * exp((last - node) * first) / (node + end);
      mass += share;
      mean += share / (node + end);
    }
    const node = mass / mean - end;
    s[s.length - 1] = node;
    omega[s.length - 1] = sine * spacing * mass * mass / mean * exp((node - last) * first);
    return [s, omega, pow(low, a + 1) * slope];
  }

  function halfHat(s) {                                  // (e^s − 1 − s)/s²
    if (s >= 0.5) return (expm1(s) - s) / (s * s);
    let series = 1;
    for (let j = 14; j > 2; j--) series = 1 + series * s / j;
    return series / 2;
  }

  // w_0 … w_L, `start` in their place for the first sample, and the exponentials for all older ones.
  function kernel(family, q, steps, tolerance) {
    const one = v => Float64Array.of(v), none = new Float64Array(0), whole = { ramp: 0, shift: 1 / 6 };
    if (q === 1 && family === "pi")
      return { weights: Float64Array.of(0.5, 1), start: Float64Array.of(0, 0.5), decay: one(0), amplitude: one(1), ratio: one(0.5), ...whole };
    if (q === 1) return { weights: Float64Array.of(1, -1), start: Float64Array.of(1, -1), decay: none, amplitude: none, ratio: none, ...whole };
    if (family === "gl") {
      const w = new Float64Array(LAGS + 1).fill(1);
      for (let k = 1; k <= LAGS; k++) w[k] = w[k - 1] * (k - 1 - q) / k;
      const [s, omega] = quadrature(1 + q, -sineRatio(q), LAGS + 1 - 0.7 * q, steps, tolerance, false);
      const amplitude = omega.map((v, m) => v * pow(s[m] > 0 ? -expm1(-s[m]) / s[m] : 1, q) * exp(-s[m] * (LAGS + 1 - q)));
      return { weights: w, start: w, decay: s.map(v => expm1(-v)), amplitude, ratio: s.map(() => 1), ...whole };
    }
    const [b, a] = trapezoidalWeights(q, LAGS);
    const [s, omega, slope] = quadrature(1 - q, sineRatio(1 - q), LAGS + 0.7, steps, tolerance, q > 1);
    const hat = s.map(v => (v > 0 ? pow(sinh(v / 2) / (v / 2), 2) : 1));
    const amplitude = omega.map((v, m) => v * hat[m] * exp(-s[m] * (LAGS + 1)));
    amplitude[0] -= slope * (LAGS + 1);
    return { weights: b, start: a, decay: s.map(v => expm1(-v)), amplitude, ratio: s.map((v, m) => halfHat(v) / hat[m]), ramp: -slope, shift: 1 / 6 };
  }

  // --- the start: fracid.solver.starting ------------------------------------------------------------

  const APART = 0.09, MOST = 5, ROOM = 64, SUMMED = 32;

  // Sums of the orders below 1, the smallest that are apart; and 1 where none is near it.
  function exponents(orders) {
    let sums = [0];
    for (let k = 0; k < sums.length && k < ROOM; k++) {
      for (const q of orders) {
        const total = sums[k] + q;
        if (q >= 1e-9 && total < 1 - 1e-9 && sums.length < ROOM && !sums.some(s => abs(s - total) <= 1e-9)) sums.push(total);
      }
      sums.sort((a, b) => a - b);
    }
    const selection = [];
    for (const s of sums.slice(1)) {
      if (selection.length < MOST && s - (selection.at(-1) ?? 0) > (selection.length ? APART : 0)) selection.push(s);
    }
    if (selection.length && selection.at(-1) < 0.75) selection.push(1);
    return selection;
  }

  function knotsUpTo(steps) {
    const knots = Array.from({ length: 65 }, (_, n) => n);
    while (knots.at(-1) < steps || knots.length % 2 === 0) knots.push(knots.at(-1) + Math.floor(knots.at(-1) / 32));
    return knots;
  }

  function expansion(q, s) {
    const [z0, z1, z2, z3] = [0, 1, 2, 3].map(k => zeta(-s - k)), g = gamma(s + 1);
    const start = [-z0 * inverseGamma(q), z1 * inverseGamma(q - 1), -(z2 / 2 + z0 / 12) * inverseGamma(q - 2), (z3 / 6 + z1 / 12) * inverseGamma(q - 3)];
    const rule = [-g * inverseGamma(s + q - 1) / 12, -g * inverseGamma(s + q - 3) / 360, -g * inverseGamma(s + q - 5) / 20160];
    const [y1, y2, y3, y4] = [1, 2, 3, 4].map(k => zeta(-q - k)), c = s * (s - 1) / gamma(q + 2);
    const last = [-y1 * c, y2 * c * (s - 2), -(y3 / 2 + y1 / 12) * c * (s - 2) * (s - 3), (y4 / 6 + y2 / 12) * c * (s - 2) * (s - 3) * (s - 4)];
    return [start, rule, last];
  }

  // E_σ(n) at the knots, a row an exponent.
  function errorsOfPowers(q, sigma, knots) {
    const [w] = trapezoidalWeights(q, SUMMED);
    return sigma.map(s => {
      const E = new Float64Array(knots.length);
      if (s === 1) return E;
      const exact = gamma(s + 1) / gamma(s + q + 1), [start, rule, last] = expansion(q, s);
      const powers = Float64Array.from({ length: SUMMED + 1 }, (_, k) => pow(k, s));
      for (let j = 1; j < knots.length; j++) {
        const n = knots[j], r = 1 / n;
        if (n <= SUMMED) {
          E[j] = exact * pow(n, s + q);
          for (let k = 1; k <= n; k++) E[j] -= w[n - k] * powers[k];
        } else {
          E[j] = pow(n, q - 1) * (start[0] + r * (start[1] + r * (start[2] + r * start[3])))
            + pow(n, s + q - 2) * (rule[0] + r * r * (rule[1] + r * r * rule[2]))
            + pow(n, s - 2) * (last[0] + r * (last[1] + r * (last[2] + r * last[3])));
        }
      }
      return E;
    });
  }

  // M with x_n = x_0 + h^q Σ M_nk f_k, n ≤ s.
  function startingWeights(q, E, fit) {
    const s = fit[0].length, [w, a] = trapezoidalWeights(q, s), M = Array.from({ length: s + 1 }, () => new Float64Array(s + 1));
    for (let n = 1; n <= s; n++) {
      M[n][0] = a[n];
      for (let k = 1; k <= n; k++) M[n][k] = w[n - k];
      for (let k = 1; k <= s; k++) {
        for (let e = 0; e < fit.length; e++) {
          M[n][k] += E[e][n] * fit[e][k - 1];
          M[n][0] -= E[e][n] * fit[e][k - 1];
        }
      }
    }
    return M;
  }

  // h^q ∂f/∂x at the start.
  function jacobian(f, run) {
    const S = run.orders.length, x = run.initial.slice(), A = Array.from({ length: S }, () => new Float64Array(S));
    const u = run.inputs.subarray(0, run.width), sides = [new Float64Array(2 * S), new Float64Array(2 * S)];
    for (let c = 0; c < S; c++) {
      const d = 1e-6 * (0.01 + abs(x[c])), kept = x[c];
      sides.forEach((out, side) => {
        x[c] = kept + (side ? d : -d);
        f(x, u, out);
      });
      x[c] = kept;
      for (let i = 0; i < S; i++) A[i][c] = run.gain[i] * (sides[1][i] - sides[0][i]) / (2 * d);
    }
    return A;
  }

  function spectralRadius(A) {
    let power = A;
    for (let k = 0; k < 4; k++) power = power.map(row => row.map((_, c) => row.reduce((sum, v, j) => sum + v * power[j][c], 0)));
    return pow(max(...power.map(row => row.reduce((sum, v) => sum + abs(v), 0))), 1 / 16);
  }

  function ordersThatMove(f, run, A) {
    const S = run.orders.length, now = new Float64Array(2 * S), later = new Float64Array(2 * S), { inputs, width } = run;
    f(run.initial, inputs.subarray(0, width), now);
    f(run.initial, inputs.length > width ? inputs.subarray(width, 2 * width) : inputs.subarray(0, width), later);
    const moves = Array.from({ length: S }, (_, i) => now[i] !== 0 || later[i] !== 0);
    for (let k = 0; k < S; k++) for (let i = 0; i < S; i++) for (let c = 0; c < S; c++) moves[i] ||= moves[c] && A[i][c] !== 0;
    return Array.from(run.orders).filter((_, i) => moves[i]);
  }

  // Gauss elimination with row pivots: A x = b in place.
  function factor(A) {
    const n = A.length, pivots = [];
    for (let k = 0; k < n; k++) {
      let p = k;
      for (let i = k + 1; i < n; i++) if (abs(A[i][k]) > abs(A[p][k])) p = i;
      pivots.push(p);
      [A[k], A[p]] = [A[p], A[k]];
      for (let i = k + 1; i < n; i++) {
        const share = A[i][k] /= A[k][k];
        for (let c = k + 1; c < n; c++) A[i][c] -= share * A[k][c];
      }
    }
    return pivots;
  }

  function substitute(A, pivots, b) {
    const n = A.length;
    for (let k = 0; k < n; k++) [b[k], b[pivots[k]]] = [b[pivots[k]], b[k]];
    for (let i = 1; i < n; i++) for (let c = 0; c < i; c++) b[i] -= A[i][c] * b[c];
    for (let i = n - 1; i >= 0; i--) {
      for (let c = i + 1; c < n; c++) b[i] -= A[i][c] * b[c];
      b[i] /= A[i][i];
    }
  }

  function inverse(A) {
    const n = A.length, LU = A.map(row => row.slice()), pivots = factor(LU);
    const columns = A.map((_, c) => {
      const b = new Float64Array(n);
      b[c] = 1;
      substitute(LU, pivots, b);
      return b;
    });
    return A.map((_, r) => columns.map(column => column[r]));
  }

  const NOTHING = { together: 0, begun: [], knots: [0, 1, Infinity], C: [] };

  // The first s steps, solved together, and C(n) at the knots, which corrects all later ones.
  function startTogether(f, run) {
    const S = run.orders.length, A = jacobian(f, run), sigma = exponents(ordersThatMove(f, run, A)), s = sigma.length;
    if (s === 0 || !(spectralRadius(A) <= 1)) return NOTHING;
    const { E, M, fit, knots } = correctionTables(run, sigma);
    const x = Array.from({ length: s + 1 }, () => run.initial.slice()), fs = x.map(() => new Float64Array(2 * S));
    const W = Array.from({ length: s * S }, () => new Float64Array(s * S));
    for (let n = 1; n <= s; n++) for (let i = 0; i < S; i++) for (let k = 1; k <= s; k++) for (let c = 0; c < S; c++)
      W[(n - 1) * S + i][(k - 1) * S + c] = (n === k && i === c) - M[i][n][k] * A[i][c];
    const pivots = factor(W), b = new Float64Array(s * S), { u, last } = withoutJumps(run, s);
    let moved = Infinity;
    for (let iteration = 0; iteration < 50 && moved >= 1e-14; iteration++) {
      for (let n = 0; n <= s; n++) f(x[n], u[n], fs[n]);
      for (let n = 1; n <= s; n++) for (let i = 0; i < S; i++) {
        let total = run.initial[i] - x[n][i];
        for (let k = 0; k <= s; k++) total += run.gain[i] * M[i][n][k] * fs[k][i];
        b[(n - 1) * S + i] = total;
      }
      substitute(W, pivots, b);
      moved = 0;
      for (let n = 1; n <= s; n++) for (let i = 0; i < S; i++) {
        const change = b[(n - 1) * S + i];
        x[n][i] += change;
        moved = max(moved, abs(change) / (1e-3 + abs(x[n][i])));
        if (!(abs(x[n][i]) <= run.limit)) return NOTHING;
      }
    }
    if (!(moved < 1e-11)) return NOTHING;
    const C = run.initial.map((_, i) => i);
    return { together: last, begun: x, knots, C: Array.from(C, i => {
      const sum = new Float64Array(knots.length);
      fit.forEach((row, e) => {
        const c = row.reduce((total, v, k) => total + v * (fs[k + 1][i] - fs[0][i]), 0);
        for (let j = 0; j < sum.length; j++) sum[j] += c * E[i][e][j];
      });
      return sum;
    }) };
  }

  // The inputs of s steps as they would go on without their jumps, and the step at which they first do jump, or s.
  function withoutJumps({ inputs, jumps, width }, s) {
    const row = (of, n) => (of.length > width ? of.subarray(n * width, (n + 1) * width) : of);
    const moved = new Float64Array(width), u = [];
    let last = s;
    for (let n = 0; n <= s; n++) {
      u.push(row(inputs, n).map((v, c) => v - moved[c]));
      if (jumps && n > 0) for (let c = 0; c < width; c++) moved[c] += row(jumps, n)[c] - row(inputs, n)[c];
      if (n < last && moved.some(v => v !== 0)) last = n;
    }
    return { u, last };
  }

  // They depend on the orders only: sliders of other values find them made.
  let lastTables = { key: "" };
  function correctionTables(run, sigma) {
    const key = [run.orders.join(), sigma.join(), run.memory].join(";");
    if (lastTables.key === key) return lastTables;
    const knots = knotsUpTo(run.memory + 8), fit = inverse(sigma.map((_, k) => sigma.map(s => pow(k + 1, s))));
    const distinct = new Map([...new Set(run.orders)].map(q => [q, errorsOfPowers(q, sigma, knots)]));
    const weights = new Map([...distinct].map(([q, E]) => [q, startingWeights(q, E, fit)]));
    const of = table => Array.from(run.orders, q => table.get(q));
    return lastTables = { key, knots, fit, E: of(distinct), M: of(weights) };
  }

  // --- the history: fracid.solver.history, a step at a time ---------------------------------------------

  const kernels = new Map();                             // of the last few orders
  function kernelOf(...key) {
    const name = key.join();
    if (!kernels.has(name)) {
      if (kernels.size > 24) kernels.clear();
      kernels.set(name, kernel(...key));
    }
    return kernels.get(name);
  }

  class Sum {                                            // H_n = Σ w_k v_(n−k) of one state
    constructor(k, steps, first) {
      Object.assign(this, k);
      this.lags = k.weights.length - 1;
      this.modes = k.decay.length;
      this.sums = new Float64Array(this.modes);
      this.linear = 0;
      this.v = new Float64Array(steps + 1);
      this.v[0] = first;
    }

    at(n) {
      const { v, weights, lags, sums, decay, amplitude, modes } = this;
      let H = 0;
      if (n <= lags) {
        for (let k = 1; k < n; k++) H += weights[k] * v[n - k];
        return H + this.start[n] * v[0];
      }
      if (n === lags + 1) {
        for (let m = 0; m < modes; m++) {
          sums[m] = this.ratio[m] * v[0];
          H += amplitude[m] * sums[m];
        }
        this.linear = -this.shift * v[0];
      } else {
        const gone = v[n - lags - 1];
        if (modes) this.linear += sums[0];
        for (let m = 0; m < modes; m++) {
          const Y = sums[m] + (decay[m] * sums[m] + gone);
          sums[m] = Y;
          H += amplitude[m] * Y;
        }
      }
      for (let k = 1; k <= lags; k++) H += weights[k] * v[n - k];
      return this.ramp === 0 ? H : H + this.ramp * this.linear;
    }
  }

  function store(run, x, n, out) {
    if (n % run.every) return;
    const at = out.samples++ * x.length;
    for (let i = 0; i < x.length; i++) out.states[at + i] = x[i];
  }

  function finite(f, S) {
    for (let i = 0; i < S; i++) if (!Number.isFinite(f[i])) return false;
    return true;
  }

  // --- the schemes: fracid.solver.schemes ------------------------------------------------------------

  function stepGl(f, run, out) {
    const S = run.orders.length, { raw, lastFirst, inputs, width, gain } = run;
    const x = run.initial.slice(), d = new Float64Array(2 * S), origin = raw ? new Float64Array(S) : run.initial.slice();
    const sums = Array.from(run.orders, (q, i) => new Sum(kernelOf("gl", q, run.memory, run.tolerance), run.steps, x[i] - origin[i]));
    store(run, x, 0, out);
    for (let n = 1; n <= run.steps; n++) {
      const u = inputs.length > width ? inputs.subarray((n - 1) * width, n * width) : inputs;
      if (!lastFirst) f(x, u, d);
      for (let i = S - 1; i >= 0; i--) {
        if (lastFirst) f(x, u, d);
        const v = gain[i] * d[i] - sums[i].at(n);
        sums[i].v[n] = v;
        x[i] = origin[i] + v;
        if (!(abs(x[i]) <= run.limit)) return;
      }
      store(run, x, n, out);
    }
    out.completed = true;
  }

  const SLOW = 0.25, SETTLED = 1e-9, SMALL = 1e-3, NEWTON = 12, EARLY = 64, SLACK = 0.05, OPEN = 1e-3;

  function stepPi(f, run, out) {
    const S = run.orders.length, { inputs, jumps, width, gain, relaxing, limit, step: h } = run, corrections = run.newton ? 0 : 1;
    const { together, begun, knots, C } = startTogether(f, run), free = together + 1;
    const x = run.initial.slice(), d = new Float64Array(2 * S), before = new Float64Array(S), last = new Float64Array(S);
    const known = new Float64Array(S), scale = new Float64Array(S), newest = new Float64Array(S), trial = new Float64Array(2 * S);
    const jump = new Float64Array(S), rest = relaxing.map(() => new Float64Array(4));
    const taken = new Float64Array(S), next = new Float64Array(S);
    const share = Array.from(run.orders, q => q - (pow(2, q + 1) - 2) / 3);
    const u = inputs.slice(0, width);
    let W = null, pivots = null, piece = 0;

    function relax(f1) {                                 // the new value of those that relax, into known
      for (let k = 0; k < relaxing.length; k++) {
        const i = relaxing[k], z0 = rest[k][0], c0 = rest[k][1], a0 = rest[k][2], a1 = f1[S + k];
        const mean = (a0 + a1) / 2, A = mean * h, R = 1 / (1 + A + A * A / 2);
        let c1 = f1[i] + a1 * x[i];
        if (mean > 0) c1 *= mean / (a1 * (1 - R) + mean * R);
        known[i] = R * (z0 + h / 2 * (c0 + (1 + A) * c1));
      }
    }

    function keepRelaxing() {
      for (let k = 0; k < relaxing.length; k++) {
        const i = relaxing[k], a = d[S + k];
        rest[k][0] = x[i];
        rest[k][1] = d[i] + a * x[i];
        rest[k][2] = a;
      }
    }

    function invert() {
      relax(d);
      for (let k = 0; k < relaxing.length; k++) rest[k][3] = known[relaxing[k]];
      W = Array.from({ length: S }, () => new Float64Array(S));
      for (let c = 0; c < S; c++) {
        const value = x[c], e = 1e-7 * (0.01 + abs(value));
        x[c] = value + e;
        f(x, u, trial);
        relax(trial);
        x[c] = value;
        for (let i = 0; i < S; i++) W[i][c] = (i === c) - newest[i] * (trial[i] - d[i]) / e;
        for (let k = 0; k < relaxing.length; k++) W[relaxing[k]][c] = (relaxing[k] === c) - (known[relaxing[k]] - rest[k][3]) / e;
      }
      pivots = factor(W);
    }

    function correction() {                              // by which x is to move, into next
      relax(d);
      for (let i = 0; i < S; i++) next[i] = known[i] + newest[i] * d[i] - x[i];
      substitute(W, pivots, next);
      return finite(next, S);
    }

    function sizeOf(move) {
      let size = 0;
      for (let i = 0; i < S; i++) size = max(size, abs(move[i]) / (SMALL + abs(x[i]) + abs(taken[i])));
      return size;
    }

    let keep = false;
    function newton() {                                  // false where x would still move by much in the end
      let fresh = !keep, part = 1;
      keep = false;
      if (fresh) invert();
      if (!correction()) return false;
      for (let iteration = 0; iteration < NEWTON; iteration++) {
        if (part === 1) taken.set(next);
        for (let i = 0; i < S; i++) x[i] += part * taken[i];
        f(x, u, d);
        const moved = sizeOf(taken);
        if (!(moved > 1e-12)) {
          keep = true;
          return true;
        }
        let following = correction() ? sizeOf(next) : Infinity;
        if (following >= moved) {                        // too far: back, and on with a new W, or half as far
          for (let i = 0; i < S; i++) x[i] -= part * taken[i];
          if (fresh) {
            part /= 2;
            continue;
          }
          f(x, u, d);
          following = Infinity;
        }
        fresh = following >= 0.1 * moved;
        part = 1;
        if (!fresh) continue;
        invert();
        if (!correction()) return false;
      }
      return sizeOf(part === 1 ? next : taken) < OPEN;
    }

    function slow() {
      let lastMove = 0, nextMove = 0;
      for (let i = 0; i < S; i++) {
        lastMove = max(lastMove, scale[i] * abs(x[i] - last[i]));
        nextMove = max(nextMove, scale[i] * abs(known[i] + newest[i] * d[i] - x[i]));
      }
      return nextMove > max(SLOW * lastMove, SETTLED) || unsettled();
    }

    function unsettled() {
      for (let k = 0; k < relaxing.length; k++) {
        const i = relaxing[k];
        if (abs(known[i] - x[i]) > SLACK * max(abs(known[i]), abs(x[i]), abs(rest[k][0]))) return true;
      }
      return false;
    }

    f(x, u, d);
    if (!finite(d, S)) return;
    const sums = Array.from(run.orders, (q, i) => new Sum(kernelOf("pi", q, run.memory, run.tolerance), run.steps, d[i]));
    for (let i = 0; i < S; i++) {
      newest[i] = gain[i] * sums[i].weights[0];
      before[i] = d[i];
    }
    keepRelaxing();
    for (const i of relaxing) newest[i] = 0;
    store(run, x, 0, out);
    for (let n = 1; n <= run.steps; n++) {
      if (inputs.length > width) for (let c = 0; c < width; c++) u[c] = inputs[n * width + c];
      while (n > knots[2 * piece + 2]) piece++;
      for (let i = 0; i < S; i++) {
        let H = sums[i].at(n);
        if (together) H += parabola(knots, C[i], 2 * piece, n);
        known[i] = run.initial[i] + gain[i] * H + newest[i] * share[i] * jump[i];
        if (n % 8 === 1) scale[i] = 1 / (SMALL + abs(x[i]));
        if (n < free) x[i] = begun[n][i];
        else if (corrections > 0) x[i] = known[i] + newest[i] * (2 * d[i] - before[i]);
        before[i] = d[i];
      }
      if (n >= free && relaxing.length) {                // they follow the speed before f is asked
        for (let k = 0; k < relaxing.length; k++) x[relaxing[k]] = rest[k][0];
        f(x, u, d);
        relax(d);
        for (const i of relaxing) x[i] = known[i];
      }
      for (let sweep = n < free ? 0 : n > EARLY || corrections === 0 ? corrections : corrections + 4; sweep > 0; sweep--) {
        f(x, u, d);
        if (relaxing.length) relax(d);
        for (let i = 0; i < S; i++) {
          last[i] = x[i];
          x[i] = known[i] + newest[i] * d[i];
          if (!(abs(x[i]) <= limit)) return;
        }
      }
      f(x, u, d);
      if (relaxing.length) relax(d);
      if (n >= free && (corrections === 0 || slow()) && !newton()) return;
      for (let i = 0; i < S; i++) {
        if (!(abs(x[i]) <= limit) || !Number.isFinite(d[i])) return;
        sums[i].v[n] = d[i];
      }
      if (jumps) enterJump(n);
      if (relaxing.length) keepRelaxing();
      store(run, x, n, out);
    }
    out.completed = true;

    function enterJump(n) {                              // f before and after it; the predictor goes on from there
      const after = jumps.subarray(n * width, (n + 1) * width), jumping = after.some((v, c) => v !== u[c]);
      if (jumping) f(x, after, trial);
      for (let i = 0; i < S; i++) {
        sums[i].v[n] += jump[i] / 6;
        jump[i] = jumping ? trial[i] - d[i] : 0;
        if (!jumping) continue;
        sums[i].v[n] += jump[i] / 3;
        before[i] = trial[i] - (d[i] - before[i]);
      }
      if (jumping) d.set(trial);
    }
  }

  function parabola(knots, C, k, n) {
    const a = knots[k], b = knots[k + 1], c = knots[k + 2], one = (C[k + 1] - C[k]) / (b - a), two = (C[k + 2] - C[k + 1]) / (c - b);
    return C[k] + (n - a) * (one + (n - b) * (two - one) / (c - a));
  }

  const SHORTEST = 10000;                                // steps that the memory holds at least

  function solve(f, run) {
    const states = run.orders.length, every = run.every || 1, width = run.width || 1;
    const inputs = run.inputs || new Float64Array(width), relaxing = run.relaxing || [];
    const whole = { tolerance: 1e-10, limit: 1e4, jumps: null, ...run, inputs, every, width, relaxing, memory: max(run.steps, run.memory || 0, SHORTEST) };
    const out = { states: new Float64Array((Math.floor(run.steps / every) + 1) * states), samples: 0, completed: false };
    whole.initial = Float64Array.from(run.initial);
    if (whole.jumps && run.family === "gl") Object.assign(whole, { inputs: whole.jumps, jumps: null });  // pi2 takes both
    (run.family === "gl" ? stepGl : stepPi)(f, whole, out);
    return out;
  }

  // A model's run of one recording with other values.
  //   program     { states, orders, relaxing, width, tolerance, family, … }: of each state the name of its order, the order
  //               itself, or { complement: parameter }
  //   recording   { step, steps, every, limit, initial, inputs, jumps }; deflections: of each state that relaxes its δ,
  //               and which share of it the joint has given at the start, null for one that slides
  //   values      { orders, parameters }, by name; model: from the parameters to f
  function simulate(program, recording, values, model) {
    const { orders: q, parameters: p } = values, f = model(p), { step } = recording, time = p.time_scale ?? 1;
    const orders = program.orders.map(name => (typeof name === "number" ? name : name.complement ? 1 - (p[name.complement] ?? q[name.complement]) : q[name]));
    const gain = orders.map(o => pow(step, o) * pow(time, 1 - o)), initial = Float64Array.from(recording.initial);
    const out = new Float64Array(2 * orders.length);
    for (const { state, delta, share } of recording.deflections || []) {
      if (share !== null) initial[state] = share * p[delta];
      else {                                             // it slides: what it gains and what it forgets are in balance
        initial[state] = 0;
        f(initial, new Float64Array(program.width), out);
        const rate = out[orders.length + program.relaxing.indexOf(state)];
        initial[state] = rate > 0 ? out[state] / rate : 0;
      }
    }
    return solve(f, { ...program, ...recording, orders, gain, initial });
  }

  return { simulate, solve };
})();
