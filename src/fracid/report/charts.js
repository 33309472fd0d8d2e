"use strict";
// Curves: uPlot with the page's colours.  A chart is described by a plain record
//   { title, x, xlabel, ylabel, series: [{ label, y, kind }], bands: [{ axis, from, to, kind }], marks: [{ axis, at, text }],
//     height, logx, logy, legend }
// and built when it comes into view; on a change of theme or width, and for printing, it is built again.

const css = name => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();

const floats = text => new Float32Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);

// uPlot knows a gap as null.
const line = values => Array.from(values, v => (Number.isFinite(v) ? v : null));

function round(v, digits = 4) {
  if (v === null || v === undefined) return "–";
  const small = v !== 0 && Math.abs(v) < 1e-4;
  return (small ? (+v.toPrecision(digits)).toExponential() : String(+v.toPrecision(digits))).replaceAll("-", "−");
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
    this.heading = host.appendChild(document.createElement("div"));
    this.heading.className = "title";
    this.heading.textContent = spec.title;
    this.body = host.appendChild(document.createElement("div"));
    host.setAttribute("role", "group");
    host.setAttribute("aria-label", `${spec.title}: ${spec.ylabel} over ${spec.xlabel}`);
    host.style.minHeight = `${spec.height + 70}px`;
    Chart.all.push(this);
    Chart.watch.observe(host);
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
      label, labelSize: 22, labelFont: "12px system-ui, sans-serif", font: "12px system-ui, sans-serif",
      stroke: css("soft"), ticks: { stroke: css("grid"), width: 1, size: 4 }, gap: 4,
      values: (u, ticks) => ticks.map(v => (v === null ? "" : round(v, 6))), ...more,
    });
    const grid = log => ({ stroke: css("grid"), width: log ? 0.5 : 1 });
    return {
      width: this.width, height: spec.height,
      scales: {
        x: { time: false, distr: spec.logx ? 3 : 1 },
        y: { distr: spec.logy ? 3 : 1, range: spec.yrange },
      },
      axes: [axis(spec.xlabel, { size: 26, space: 60, grid: grid(spec.logx) }), axis(spec.ylabel, { size: 52, space: 28, grid: grid(spec.logy) })],
      series: [
        { label: spec.xname || spec.xlabel, value: (u, v) => round(v, 5) },
        ...spec.series.map(s => {
          const kind = KINDS[s.kind];
          return {
            label: s.label, stroke: css(kind.colour), width: kind.width, dash: kind.dash, spanGaps: false,
            paths: kind.points ? () => null : undefined,
            points: kind.points ? { show: true, size: 4, width: 0, fill: css(kind.colour) } : { show: false },
            value: (u, v) => round(v, s.digits || 4),
          };
        }),
      ],
      legend: { show: spec.legend !== false, live: true },
      cursor: { drag: { x: true, y: false, setScale: true }, y: false, points: { size: 7 } },
      hooks: {
        drawClear: [u => this.bands(u)],
        draw: [u => this.marks(u)],
        setScale: [(u, key) => key === "x" && spec.scaled && spec.scaled(this)],
      },
    };
  }

  bands(u) {
    const { left, top, width, height } = u.bbox;
    const clamp = (v, low, high) => Math.min(Math.max(v, low), high);
    for (const band of this.spec.bands || []) {
      const [a, b] = [band.from, band.to].map(v => u.valToPos(v, band.axis, true));
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
      ctx.setLineDash(mark.solid ? [] : [5 * uPlot.pxRatio, 3 * uPlot.pxRatio]);
      ctx.beginPath();
      if (mark.axis === "x") { ctx.moveTo(at, top); ctx.lineTo(at, top + height); } else { ctx.moveTo(left, at); ctx.lineTo(left + width, at); }
      ctx.stroke();
      if (!mark.text) continue;
      ctx.font = `${12 * uPlot.pxRatio}px system-ui, sans-serif`;
      const room = mark.axis === "x" && at + ctx.measureText(mark.text).width + 8 * uPlot.pxRatio > left + width;
      ctx.textAlign = room || mark.axis === "y" ? "right" : "left";
      const gap = 4 * uPlot.pxRatio;
      if (mark.axis === "x") ctx.fillText(mark.text, at + (room ? -gap : gap), top + (13 + 15 * (mark.row || 0)) * uPlot.pxRatio);
      else ctx.fillText(mark.text, left + width - gap, at - gap);
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

  // The cursor at a value of x; its values show in the legend.
  point(x) {
    if (this.plot) this.plot.setCursor({ left: this.plot.valToPos(x, "x"), top: 1 }, false);
  }
}

Chart.all = [];
Chart.watch = new IntersectionObserver(entries => {
  for (const entry of entries) {
    const chart = Chart.all.find(c => c.host === entry.target);
    if (entry.isIntersecting && chart && !chart.plot) chart.build();
  }
}, { rootMargin: "600px" });

Chart.rebuild = (everything = false) => {
  for (const chart of Chart.all) if (chart.plot || everything) chart.build();
};

Chart.resize = () => {
  for (const chart of Chart.all) if (chart.plot && chart.host.clientWidth !== chart.width) chart.build();
};
