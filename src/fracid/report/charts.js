"use strict";
// Curves: uPlot with the page's colours.  A chart is described by a plain record (charts.py writes it too)
//   { title, x, xlabel, ylabel, xname, series: [{ label, y, kind, unit, step }], bands: [{ axis, low, high, kind }],
//     marks: [{ axis, at, text, kind, before }], right: [[at, text]], rightlabel, height, yrange, logx, logy, bare, room, keyed }
// and built when it comes into view, in the place of the SVG that stands there for paper and where no script runs; on a
// change of theme or width it is built again.

document.documentElement.classList.add("live");

const css = name => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();

const floats = text => new Float32Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);

// uPlot knows a gap as null.
const line = values => Array.from(values, v => (Number.isFinite(v) ? v : null));

const raised = k => String(Number(k)).replace(/./g, c => "⁰¹²³⁴⁵⁶⁷⁸⁹"[c] || "⁻");

function round(v, digits = 4) {
  if (v === null || v === undefined) return "–";
  const small = v !== 0 && Math.abs(v) < 1e-4;
  if (!small) return String(+v.toPrecision(digits)).replace("-", "−");
  const [mantissa, exponent] = (+v.toPrecision(digits)).toExponential().split("e");
  return `${mantissa.replace("-", "−")}×10${raised(exponent)}`;
}

// A duration in the unit that people would use.
function inTime(seconds) {
  const [unit, size] = seconds >= 7200 ? ["h", 3600] : seconds >= 120 ? ["min", 60] : seconds >= 0.1 ? ["s", 1] : ["ms", 1e-3];
  return `${round(seconds / size, 3)} ${unit}`;
}

// A value in its unit: an angle with as many decimals as its encoder tells, two without one.
function inUnit(v, { unit, step, digits = 4, more = 0 }) {
  if (!Number.isFinite(v)) return "–";
  if (unit !== "°") return `${round(v, digits)}${unit ? ` ${unit}` : ""}`;
  const decimals = step ? Math.min(Math.max(Math.ceil(-Math.log10(step)), 0), 6) : 2;
  return `${v.toFixed(decimals + more).replace(/^-(?=.*[1-9])/, "−").replace("-", "")}°`;
}

// Which of rising values is the nearest.
function nearest(values, v) {
  let low = 0, high = values.length - 1;
  while (high - low > 1) { const m = (low + high) >> 1; if (values[m] <= v) low = m; else high = m; }
  return v - values[low] <= values[high] - v ? low : high;
}

// What an axis is called where there is so much room: its unit alone where it has a long name.
const fitting = (label, room) => (6.5 * label.length <= room ? label : (label.match(/\[[^[]*$/) || [""])[0]);

// Of a logarithmic axis the powers of ten alone, as 10⁻⁴.
const powers = (u, ticks) => ticks.map(v => {
  if (v === null) return "";
  const k = Math.round(Math.log10(v));
  return Math.abs(Math.log10(v) - k) > 1e-9 ? "" : Math.abs(k) < 3 ? round(v, 3) : `10${raised(k)}`;
});

// Half of the last label below a plot, which may stand at its very end; of a plot without labels as if it had them.
function half({ ctx, axes: [{ _splits }] }) {
  ctx.save();
  ctx.font = "12px system-ui, sans-serif";
  const { width } = ctx.measureText(round((_splits || [0]).at(-1), 6));
  ctx.restore();
  return Math.ceil(width / 2) + 2;
}

const KINDS = {
  measured: { colour: "measured", width: 3 },
  fitted: { colour: "fitted", width: 1.25 },
  residual: { colour: "residual", width: 1 },
  first: { colour: "fitted", width: 1.25 },
  second: { colour: "mark", width: 1.25 },
  third: { colour: "third", width: 1.25 },
  dashed: { colour: "soft", width: 1.25, dash: [6, 4] },
  points: { colour: "fitted", width: 0, points: true },
};

class Chart {
  constructor(host, spec) {
    this.host = host;
    this.spec = spec;
    this.plot = null;
    this.heading = host.querySelector(".title") || host.appendChild(document.createElement("div"));
    this.heading.className = "title";
    this.heading.textContent = spec.title;
    for (const s of spec.series.length > 1 && !spec.keyed ? spec.series : []) this.key(s);
    this.values = this.heading.appendChild(document.createElement("span"));
    this.values.className = "values";
    this.body = host.appendChild(document.createElement("div"));
    host.setAttribute("role", "group");
    host.setAttribute("aria-label", `${spec.title}: ${spec.ylabel} over ${spec.xlabel}`);
    host.style.minHeight = `${spec.height + 24}px`;
    Chart.all.push(this);
    Chart.watch.observe(host);
  }

  // Beside the title, what a line is.
  key({ label, kind }) {
    const key = this.heading.appendChild(document.createElement("span"));
    key.className = "key";
    key.appendChild(document.createElement("span")).className = `swatch ${kind}`;
    key.append(label);
  }

  build() {
    const range = this.plot && this.zoomed ? [this.plot.scales.x.min, this.plot.scales.x.max] : null;
    if (this.plot) this.plot.destroy();
    this.body.replaceChildren();
    this.width = this.host.clientWidth;
    const { spec } = this;
    this.plot = new uPlot(this.options(), [spec.x, ...spec.series.map(s => s.y)], this.body);
    for (const canvas of this.body.querySelectorAll("canvas")) canvas.setAttribute("aria-hidden", "true");
    if (range) this.zoom(...range);
    if (spec.built) spec.built(this);
  }

  options() {
    const { spec } = this;
    const axis = (label, more) => ({
      label: label || null, labelSize: label ? 20 : 0, labelFont: "12px system-ui, sans-serif", font: "12px system-ui, sans-serif",
      stroke: css("soft"), ticks: { stroke: css("grid"), width: 1, size: 4 }, gap: 4,
      values: (u, ticks) => ticks.map(v => (v === null ? "" : round(v, 6))), ...more,
    });
    const grid = log => ({ stroke: css("grid"), width: log ? 0.5 : 1 });
    return {
      width: this.width, height: spec.height,
      scales: {
        x: { time: false, distr: spec.logx ? 3 : 1 },
        y: { distr: spec.logy ? 3 : 1, range: spec.yrange || undefined },
      },
      axes: [
        axis(spec.xlabel, { size: spec.bare ? 6 : 24, space: 60, grid: grid(spec.logx), ...(spec.bare ? { values: () => [] } : spec.logx ? { values: powers } : {}) }),
        axis(fitting(spec.ylabel, spec.height), { size: 62, space: 26, grid: grid(spec.logy), ...(spec.logy ? { values: powers } : {}) }),
        ...(spec.right && spec.right.length ? [this.right(axis)] : []),
      ],
      series: [
        { label: spec.xname || spec.xlabel, value: (u, v) => round(v, 5) },
        ...spec.series.map(s => {
          const kind = KINDS[s.kind];
          return {
            label: s.label, stroke: css(kind.colour), width: kind.width, dash: kind.dash, spanGaps: false,
            paths: kind.points ? () => null : undefined,
            points: kind.points ? { show: true, size: 4, width: 0, fill: css(kind.colour) } : { show: false },
            value: (u, v) => inUnit(v, s),
          };
        }),
      ],
      legend: { show: false },
      padding: [6, spec.right && spec.right.length ? 0 : u => Math.max(spec.room || 10, half(u)), 0, 0],
      cursor: { drag: { x: true, y: false, setScale: true }, y: false, points: { size: 7 } },
      hooks: {
        drawClear: [u => this.bands(u, band => band.kind !== "band")],
        draw: [u => { this.bands(u, band => band.kind === "band"); this.marks(u); }], // the band over the line, or noise hides it
        setCursor: [u => this.read(u)],
        setScale: [(u, key) => key === "x" && spec.scaled && spec.scaled(this)],
      },
    };
  }

  // Ticks where they are asked for: those of a residual are whole encoder steps.
  right(axis) {
    const { right, rightlabel } = this.spec, text = new Map(right);
    return axis(rightlabel, {
      side: 1, size: 52, grid: { stroke: css("edge"), width: 0.5, dash: [2, 3] },
      splits: (u, k, low, high) => right.map(([at]) => at).filter(at => at >= low && at <= high),
      values: (u, ticks) => ticks.map(at => text.get(at) || ""),
    });
  }

  // The values under the cursor, beside the title.
  read(u, i = u.cursor.idx) {
    const named = this.spec.xname === "time" ? [] : [[this.spec.xname, round(u.data[0][i], 4)]];
    const values = u.series.slice(1).map((s, k) => [s.label, s.value(u, u.data[k + 1][i])]);
    this.values.textContent = i === null || i === undefined ? "" : [...named, ...values].map(pair => pair.join(" ")).join(", ");
  }

  bands(u, kinds) {
    const { left, top, width, height } = u.bbox;
    const clamp = (v, low, high) => Math.min(Math.max(v, low), high);
    for (const band of (this.spec.bands || []).filter(kinds)) {
      const [a, b] = [band.low, band.high].map(v => u.valToPos(v, band.axis, true));
      u.ctx.fillStyle = css(band.kind);
      if (band.axis === "x") {
        const [l, r] = [Math.min(a, b), Math.max(a, b)].map(v => clamp(v, left, left + width));
        u.ctx.fillRect(l, top, r - l, height);
      } else {
        const [l, r] = [Math.min(a, b), Math.max(a, b)].map(v => clamp(v, top, top + height));
        u.ctx.fillRect(left, l, width, r - l);
      }
    }
  }

  marks(u) {
    const { left, top, width, height } = u.bbox;
    const { ctx } = u;
    ctx.save();
    for (const mark of this.spec.marks || []) {
      const at = u.valToPos(mark.at, mark.axis, true);
      if (!(mark.axis === "x" ? at >= left && at <= left + width : at >= top && at <= top + height)) continue;
      ctx.strokeStyle = ctx.fillStyle = css(mark.kind || "mark");
      ctx.lineWidth = uPlot.pxRatio;
      ctx.setLineDash(mark.kind === "mark" && mark.text ? [] : [5 * uPlot.pxRatio, 3 * uPlot.pxRatio]);
      ctx.beginPath();
      if (mark.axis === "x") { ctx.moveTo(at, top); ctx.lineTo(at, top + height); } else { ctx.moveTo(left, at); ctx.lineTo(left + width, at); }
      ctx.stroke();
      if (!mark.text) continue;
      ctx.font = `${12 * uPlot.pxRatio}px system-ui, sans-serif`;
      const long = ctx.measureText(mark.text).width + 8 * uPlot.pxRatio, gap = 4 * uPlot.pxRatio;
      const before = mark.axis === "x" && mark.before && at - long > left, room = mark.axis === "x" && (before || at + long > left + width);
      const place = mark.axis === "x" ? [at + (room ? -gap : gap), top + (13 + 15 * (mark.before && !before)) * uPlot.pxRatio] : [left + 0.6 * width, at - gap];
      ctx.textAlign = room ? "right" : "left";
      Object.assign(ctx, { strokeStyle: css("paper"), lineWidth: 3 * uPlot.pxRatio, lineJoin: "round" });
      ctx.setLineDash([]);
      ctx.strokeText(mark.text, ...place); // lines run below it
      ctx.fillText(mark.text, ...place);
    }
    ctx.restore();
  }

  get zoomed() {
    const { min, max } = this.plot.scales.x, { x } = this.spec;
    return min > x[0] || max < x[x.length - 1];
  }

  zoom(min, max) {
    if (this.plot) this.plot.setScale("x", { min, max });
  }

  // The cursor at a value of x, its values beside the title.
  point(x) {
    if (!this.plot) return;
    this.plot.setCursor({ left: this.plot.valToPos(x, "x"), top: 1 }, false);
    this.read(this.plot, nearest(this.spec.x, x));
  }
}

Chart.all = [];
Chart.watch = new IntersectionObserver(entries => {
  for (const entry of entries) {
    const chart = Chart.all.find(c => c.host === entry.target);
    if (entry.isIntersecting && chart && !chart.plot) chart.build();
  }
}, { rootMargin: "600px" });

// What charts.py describes, its numbers unpacked.
Chart.described = said => ({
  ...said, x: line(floats(said.x)), series: said.series.map(s => ({ ...s, y: line(floats(s.y)) })), yrange: said.yrange || undefined,
});

Chart.rebuild = (everything = false) => {
  for (const chart of Chart.all) if (chart.plot || everything) chart.build();
};

Chart.resize = () => {
  for (const chart of Chart.all) if (chart.plot && chart.host.clientWidth !== chart.width) chart.build();
};
