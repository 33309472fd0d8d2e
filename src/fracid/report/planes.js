"use strict";
// A surface over two values: colours by the logarithm and their bar, lines of equal height, marks, the values under the
// cursor, in a corner the whole search where it went beyond, and a dot that follows a reader who explores.

// cividis, which people who see no red or no green read as well: https://doi.org/10.1371/journal.pone.0199239
const CIVIDIS = ["#00224e", "#123570", "#3b496c", "#575d6d", "#707173", "#8a8678", "#a59c74", "#c3b369", "#e1cc55", "#fee838"]
  .map(c => [1, 3, 5].map(i => parseInt(c.slice(i, i + 2), 16)));

function cividis(share) {
  const at = Math.min(Math.max(share, 0), 1) * (CIVIDIS.length - 1), i = Math.min(Math.floor(at), CIVIDIS.length - 2);
  return CIVIDIS[i].map((c, k) => Math.round(c + (at - i) * (CIVIDIS[i + 1][k] - c)));
}

class Plane {
  // spec: { first, second, height: [[…]], names, levels: [[at, label]], low, high, best, intervals, tried, read, pick }
  constructor(canvas, said, spec) {
    Object.assign(this, { canvas, said, spec });
    this.cell = [Math.floor(spec.first.length / 2), Math.floor(spec.second.length / 2)];
    canvas.addEventListener("pointermove", e => this.hover(e));
    canvas.addEventListener("keydown", e => this.walk(e));
    canvas.addEventListener("click", e => { const at = this.under(e); if (at && spec.pick) spec.pick(...at); });
    Plane.all.push(this);
    this.draw();
    this.tell(...spec.best);
  }

  draw() {
    const { canvas, spec } = this, ratio = devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height) return; // on paper its drawing stands here
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    const ctx = this.ctx = canvas.getContext("2d");
    ctx.scale(ratio, ratio);
    this.box = { left: 70, top: 10, width: width - 178, height: height - 54 };
    this.corner = this.cornerOf(spec);
    this.surface();
    this.contours();
    this.integers();
    this.axes();
    this.bar();
    if (spec.tried) for (const [a, b] of spec.tried) this.dot(a, b);
    this.words();
    this.cross();
    this.star(this.x(spec.best[0]), this.y(spec.best[1]), 9);
    if (this.corner) this.search();
    this.picture = Object.assign(document.createElement("canvas"), { width: canvas.width, height: canvas.height });
    this.picture.getContext("2d").drawImage(canvas, 0, 0);
    if (this.now) this.follow(...this.now);
  }

  // A ring where the reader is, over the picture as it stands.
  follow(a, b) {
    this.now = [a, b];
    if (!this.picture) return;
    const { ctx, canvas } = this;
    ctx.clearRect(0, 0, canvas.width, canvas.height);
    ctx.drawImage(this.picture, 0, 0, canvas.clientWidth, canvas.clientHeight);
    if (this.spec.best.every((v, k) => Math.abs(this.now[k] - v) < 1e-9)) return; // the star is there
    if (this.inside(a, b)) this.ring(this.x(a), this.y(b), 7);
    if (this.corner) this.ring(...this.place(a, b), 5);
  }

  // Black around white: it is seen on every colour, and is no dot of the search.
  ring(x, y, radius) {
    for (const [strokeStyle, lineWidth] of [["#000", 5], ["#fff", 2.5]]) {
      Object.assign(this.ctx, { strokeStyle, lineWidth });
      this.ctx.beginPath();
      this.ctx.arc(x, y, radius, 0, 7);
      this.ctx.stroke();
    }
  }

  // Where an order is an integer.
  integers() {
    const { box, ctx, spec } = this, within = (v, axis) => v !== null && v > axis[0] && v < axis.at(-1);
    const [a, b] = spec.integers || [null, null];
    Object.assign(ctx, { strokeStyle: "#fff", lineWidth: 1.5 });
    ctx.setLineDash([6, 5]);
    ctx.beginPath();
    if (within(a, spec.first)) { ctx.moveTo(this.x(a), box.top); ctx.lineTo(this.x(a), box.top + box.height); }
    if (within(b, spec.second)) { ctx.moveTo(box.left, this.y(b)); ctx.lineTo(box.left + box.width, this.y(b)); }
    ctx.stroke();
    ctx.setLineDash([]);
  }

  // --- the whole search, in the corner where the surface is highest

  cornerOf({ first, second, height, tried }) {
    if (!tried || tried.every(([a, b]) => this.inside(a, b))) return null;
    const mean = (i, j) => {
      const rows = first.map((_, k) => k).filter(k => (i ? k >= first.length * 2 / 3 : k < first.length / 3));
      const columns = second.map((_, k) => k).filter(k => (j ? k >= second.length * 2 / 3 : k < second.length / 3));
      return rows.reduce((sum, k) => sum + columns.reduce((part, l) => part + (height[k][l] ?? Infinity), 0), 0);
    };
    const [i, j] = [[0, 1], [1, 1], [0, 0], [1, 0]].reduce((best, at) => (mean(...at) > mean(...best) ? at : best));
    const { left, top, width, height: tall } = this.box, size = [0.3 * width, 0.3 * tall], edge = 6;
    const ends = k => [Math.min(...tried.map(t => t[k])), Math.max(...tried.map(t => t[k]))];
    return { x: i ? left + width - size[0] - edge : left + edge, y: j ? top + edge : top + tall - size[1] - edge, width: size[0], height: size[1], ends: [ends(0), ends(1)] };
  }

  covered(x, y) {
    const c = this.corner;
    return x > c.x - 40 && x < c.x + c.width + 4 && y > c.y - 16 && y < c.y + c.height + 4;
  }

  // A point in the corner; one beyond it on its edge.
  place(a, b) {
    const { x, y, width, height, ends } = this.corner, room = 8;
    const share = (v, [low, high]) => Math.min(Math.max((v - low) / (high - low || 1), 0), 1);
    return [x + room + share(a, ends[0]) * (width - 2 * room), y + height - room - share(b, ends[1]) * (height - 2 * room)];
  }

  search() {
    const { ctx, spec } = this, { x, y, width, height } = this.corner;
    Object.assign(ctx, { fillStyle: css("paper"), strokeStyle: css("soft"), lineWidth: 1 });
    ctx.fillRect(x, y, width, height);
    ctx.strokeRect(x, y, width, height);
    ctx.beginPath();
    for (const point of spec.tried) ctx.lineTo(...this.place(...point));
    ctx.stroke();
    ctx.fillStyle = css("ink");
    for (const point of spec.tried) { ctx.beginPath(); ctx.arc(...this.place(...point), 1.6, 0, 7); ctx.fill(); }
    const [left, top] = this.place(spec.first[0], spec.second.at(-1)), [right, bottom] = this.place(spec.first.at(-1), spec.second[0]);
    ctx.strokeStyle = css("mark");
    ctx.strokeRect(left, top, right - left, bottom - top);
    this.star(...this.place(...spec.best), 5);
  }

  bar() {
    const { box, ctx, spec } = this, x = box.left + box.width + 10, n = 60, log = Math.log;
    for (let k = 0; k < n; k++) {
      ctx.fillStyle = `rgb(${cividis((k + 0.5) / n)})`;
      ctx.fillRect(x, box.top + box.height * (1 - (k + 1) / n), 12, box.height / n + 0.6);
    }
    Object.assign(ctx, { fillStyle: css("soft"), strokeStyle: css("line"), font: "12px system-ui, sans-serif", textAlign: "left", lineWidth: 1 });
    ctx.strokeRect(x, box.top, 12, box.height);
    let last = Infinity;
    for (const [at, label] of spec.levels) {
      const y = box.top + box.height * (1 - log(at / spec.low) / log(spec.high / spec.low));
      if (y < box.top || y > box.top + box.height || last - y < 16) continue;
      ctx.fillRect(x + 12, y, 3, 1);
      ctx.fillText(label, x + 17, y + 4);
      last = y;
    }
    this.upright(spec.title, x + 92);
  }

  // Words that run upward beside the surface.
  upright(words, x) {
    const { box, ctx } = this;
    ctx.save();
    ctx.translate(x, box.top + box.height / 2);
    ctx.rotate(-Math.PI / 2);
    ctx.textAlign = "center";
    ctx.fillText(words, 0, 0);
    ctx.restore();
  }

  x(a) { const { first } = this.spec, { left, width } = this.box; return left + (a - first[0]) / (first.at(-1) - first[0]) * width; }
  y(b) { const { second } = this.spec, { top, height } = this.box; return top + height - (b - second[0]) / (second.at(-1) - second[0]) * height; }

  inside(a, b) {
    const { first, second } = this.spec;
    return a >= first[0] && a <= first.at(-1) && b >= second[0] && b <= second.at(-1);
  }

  // Between the points: linear in each direction.  null where a run failed.
  height(a, b) {
    const { first, second, height } = this.spec;
    const [i, u] = place(first, a), [j, v] = place(second, b);
    const h = [height[i][j], height[i + 1][j], height[i][j + 1], height[i + 1][j + 1]];
    if (h.some(v => v === null)) return null;
    return (1 - u) * (1 - v) * h[0] + u * (1 - v) * h[1] + (1 - u) * v * h[2] + u * v * h[3];
  }

  surface() {
    const { box, ctx, spec } = this, { first, second } = spec, n = 160;
    const image = ctx.createImageData(n, n), log = Math.log;
    for (let row = 0; row < n; row++) for (let column = 0; column < n; column++) {
      const a = first[0] + (column + 0.5) / n * (first.at(-1) - first[0]);
      const b = second.at(-1) - (row + 0.5) / n * (second.at(-1) - second[0]);
      const h = this.height(a, b), at = 4 * (row * n + column);
      const share = h === null ? null : log(Math.max(h, spec.low) / spec.low) / log(spec.high / spec.low);
      image.data.set(share === null ? [128, 128, 128, 90] : [...cividis(share), 255], at);
    }
    const small = Object.assign(document.createElement("canvas"), { width: n, height: n });
    small.getContext("2d").putImageData(image, 0, 0);
    ctx.drawImage(small, box.left, box.top, box.width, box.height);
  }

  // Marching squares on the grid itself, straight within a cell.
  contours() {
    const { ctx, spec } = this, { first, second, height } = spec;
    ctx.lineWidth = 1;
    ctx.font = "11px system-ui, sans-serif";
    const labels = []; // where there is one already
    for (const [at, label] of spec.levels) {
      ctx.strokeStyle = "rgba(255, 255, 255, 0.85)";
      ctx.beginPath();
      const ends = [];
      for (let i = 0; i + 1 < first.length; i++) for (let j = 0; j + 1 < second.length; j++) {
        const corners = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]];
        if (corners.some(([k, l]) => height[k][l] === null)) continue;
        const cuts = [];
        corners.forEach(([k, l], c) => {
          const [m, o] = corners[(c + 1) % 4], h = height[k][l], g = height[m][o];
          if ((h < at) === (g < at)) return;
          const s = (at - h) / (g - h);
          cuts.push([this.x(first[k] + s * (first[m] - first[k])), this.y(second[l] + s * (second[o] - second[l]))]);
        });
        for (let c = 0; c + 1 < cuts.length; c += 2) { ctx.moveTo(...cuts[c]); ctx.lineTo(...cuts[c + 1]); ends.push(cuts[c], cuts[c + 1]); }
      }
      ctx.stroke();
      if (!ends.length) continue;
      const right = ends.reduce((a, b) => (b[0] > a[0] ? b : a)), left = ends.reduce((a, b) => (b[0] < a[0] ? b : a));
      if (right[0] - left[0] < 50) continue; // no room for its number
      const free = ([x, y]) => !(this.corner && this.covered(x, y)) && !labels.some(([u, v]) => Math.hypot(x - u, y - v) < 24);
      const place = [right, left].find(free);
      if (place) labels.push([...place, label]);
    }
    this.labels = labels;
  }

  // The lines' numbers, within the frame, on top of the dots.
  words() {
    const { box, ctx } = this, right = box.left + box.width, base = box.top + box.height - 5;
    ctx.font = "11px system-ui, sans-serif";
    for (const [x, y, label] of this.labels) {
      const late = x + 6 + ctx.measureText(label).width > right;
      const place = [late ? Math.min(x, right) - 4 : x + 2, Math.min(y + 12, base)];
      ctx.textAlign = late ? "right" : "left";
      ctx.lineWidth = 3;
      ctx.strokeStyle = "rgba(0, 0, 0, 0.75)";
      ctx.strokeText(label, ...place);
      ctx.lineWidth = 1;
      ctx.fillStyle = "#fff";
      ctx.fillText(label, ...place);
    }
  }

  axes() {
    const { box, ctx, spec } = this;
    ctx.fillStyle = css("soft");
    ctx.strokeStyle = css("line");
    ctx.strokeRect(box.left, box.top, box.width, box.height);
    ctx.font = "12px system-ui, sans-serif";
    ctx.textAlign = "center";
    for (const v of ticks(spec.first, 5)) ctx.fillText(round(v, 5), this.x(v), box.top + box.height + 16);
    ctx.fillText(spec.names[0], box.left + box.width / 2, box.top + box.height + 36);
    ctx.textAlign = "right";
    for (const v of ticks(spec.second, 6)) ctx.fillText(round(v, 5), box.left - 6, this.y(v) + 4);
    this.upright(spec.names[1], 12);
  }

  dot(a, b) {
    if (!this.inside(a, b)) return;
    const { ctx } = this;
    ctx.fillStyle = "rgba(255, 255, 255, 0.8)";
    ctx.beginPath();
    ctx.arc(this.x(a), this.y(b), 1.2, 0, 7);
    ctx.fill();
  }

  // The two intervals as bars.
  cross() {
    const { box, ctx, spec } = this, [a, b] = spec.best;
    const within = (v, low, high) => Math.min(Math.max(v, low), high);
    ctx.strokeStyle = "#000";
    ctx.lineWidth = 2;
    (spec.intervals || []).forEach((ends, k) => {
      if (!ends) return;
      ctx.beginPath();
      if (k === 0) for (const e of ends) ctx.lineTo(within(this.x(e), box.left, box.left + box.width), this.y(b));
      else for (const e of ends) ctx.lineTo(this.x(a), within(this.y(e), box.top, box.top + box.height));
      ctx.stroke();
    });
  }

  star(x, y, size) {
    const { ctx } = this;
    ctx.beginPath();
    for (let k = 0; k < 10; k++) {
      const r = k % 2 ? 0.4 * size : size, angle = -Math.PI / 2 + k * Math.PI / 5;
      ctx.lineTo(x + r * Math.cos(angle), y + r * Math.sin(angle));
    }
    ctx.closePath();
    ctx.fillStyle = "#d55e00";
    ctx.strokeStyle = "#000";
    ctx.lineWidth = 1;
    ctx.fill();
    ctx.stroke();
  }

  hover(event) { this.tell(...(this.under(event) || this.spec.best)); }

  // The two values under a pointer; null beside the surface.
  under({ offsetX, offsetY }) {
    const { first, second } = this.spec, { left, top, width, height } = this.box;
    const u = (offsetX - left) / width, v = 1 - (offsetY - top) / height;
    if (u < 0 || u > 1 || v < 0 || v > 1) return null;
    return [first[0] + u * (first.at(-1) - first[0]), second[0] + v * (second.at(-1) - second[0])];
  }

  walk(event) {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowDown: [0, -1], ArrowUp: [0, 1] }[event.key];
    if (!step) return;
    event.preventDefault();
    const { first, second } = this.spec;
    this.cell = [first, second].map((axis, k) => Math.min(Math.max(this.cell[k] + step[k], 0), axis.length - 1));
    this.tell(first[this.cell[0]], second[this.cell[1]]);
  }

  tell(a, b) {
    const { names } = this.spec, h = this.inside(a, b) ? this.height(a, b) : null;
    this.said.textContent = `${names[0]} ${round(a, 4)}, ${names[1]} ${round(b, 4)}: ${h === null ? "no run ended" : this.spec.read(h)}`;
  }
}

Plane.all = [];

function place(axis, v) {
  let i = 0;
  while (i < axis.length - 2 && axis[i + 1] < v) i++;
  return [i, Math.min(Math.max((v - axis[i]) / (axis[i + 1] - axis[i]), 0), 1)];
}

function ticks(axis, count) {
  const low = axis[0], high = axis.at(-1), raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map(m => m * power).find(s => s >= raw);
  return Array.from({ length: count + 2 }, (_, k) => (Math.ceil(low / step) + k) * step).filter(v => v <= high + 1e-9 * step);
}

// --- the cost over two orders

// The rise of the cost above its least, four decades of it; the cost itself where the least means nothing.
function costOverOrders(p) {
  const flat = floats(p.height), n = p.second.length, height = p.first.map((_, i) => line(flat.subarray(i * n, (i + 1) * n)));
  const read = h => (p.least > 0 ? `cost ${round(p.least * (1 + h), 4)}, ${h < 1e-6 ? "the lowest" : h < 1 ? `${round(100 * h, 2)} % above the lowest` : `${round(1 + h, 3)} times the lowest`}` : `${p.scale.title} ${round(h, 3)}`);
  return { ...p, ...p.scale, height, read };
}
