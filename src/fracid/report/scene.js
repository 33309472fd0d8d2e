"use strict";
// The scene of a model: bodies in a plane, each from one point to another (fracid.models.scene).  `scenePose`, written
// from the model's own text, makes of the constants a function of the outputs that fills x and y of all ends.

class Scene {
  constructor(canvas, said) {
    Object.assign(this, { canvas, bodies: said.bodies, constants: said.constants });
    this.ends = new Float64Array(4 * this.bodies.length);
    this.of(Object.keys(said.constants)[0]);
    this.frame([said.outputs.map(() => 0)]);
  }

  // Its constants in one recording.
  of(recording) { this.pose = scenePose(this.constants[recording]); }

  at(values) {
    this.pose(values, [], this.ends);
    return this.bodies.map((body, k) => ({ ...body, from: [this.ends[4 * k], this.ends[4 * k + 1]], to: [this.ends[4 * k + 2], this.ends[4 * k + 3]] }));
  }

  // Put into the picture all that is reached.
  frame(poses) {
    const low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    for (const values of poses) {
      for (const { from, to, width, shape } of this.at(values)) {
        const reach = shape === "disc" ? Math.hypot(to[0] - from[0], to[1] - from[1]) : width / 2;
        for (const point of shape === "disc" ? [from] : [from, to]) for (const k of [0, 1]) {
          if (!Number.isFinite(point[k])) continue;
          low[k] = Math.min(low[k], point[k] - reach);
          high[k] = Math.max(high[k], point[k] + reach);
        }
      }
    }
    Object.assign(this, { low, high });
  }

  draw(simulated, measured) {
    const { canvas, low, high } = this, ratio = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    const ctx = this.ctx = canvas.getContext("2d");
    this.scale = 0.9 * Math.min(width / (high[0] - low[0]), height / (high[1] - low[1]));
    ctx.setTransform(ratio, 0, 0, ratio, ratio * width / 2, ratio * height / 2);
    ctx.lineJoin = "round";
    for (const body of this.at(measured)) if (body.moves) this.body(body, true);
    for (const body of this.at(simulated)) this.body(body, false);
  }

  px([x, y]) { return [this.scale * (x - (this.low[0] + this.high[0]) / 2), this.scale * ((this.low[1] + this.high[1]) / 2 - y)]; }

  // A ghost is broader and pale, so that it shows as a rim where the two agree.
  body({ shape, from, to, width, moves }, ghost) {
    const { ctx } = this, a = this.px(from), b = this.px(to), length = Math.hypot(b[0] - a[0], b[1] - a[1]);
    if (!(length > 0)) return;
    const along = [(b[0] - a[0]) / length, (b[1] - a[1]) / length], w = this.scale * width + (ghost ? 6 : 0);
    const place = (u, v) => [a[0] + u * along[0] - v * along[1], a[1] + u * along[1] + v * along[0]];
    const line = points => { ctx.beginPath(); for (const point of points) ctx.lineTo(...point); };
    ctx.save();
    if (ghost) ctx.globalAlpha = 0.55;
    ctx.strokeStyle = css(ghost ? "ghost" : "metal-dark");
    ctx.fillStyle = css(ghost ? "ghost" : moves ? "bob" : "metal");
    ctx.lineWidth = ghost ? 4 : 1.5;
    if (shape === "spring") {
      line(Array.from({ length: 26 }, (_, k) => place(length * k / 25, k < 3 || k > 22 ? 0 : (k % 2 ? -1 : 1) * w / 2)));
    } else if (shape === "disc") {
      ctx.beginPath();
      ctx.arc(...a, length + (ghost ? 3 : 0), 0, 7);
      ctx.fill();
      if (!ghost) line([a, b]);
    } else if (shape === "rod") {
      ctx.lineCap = "round";
      for (const [thick, colour] of [[w + 2, ctx.strokeStyle], [w, ctx.fillStyle]]) {
        ctx.strokeStyle = colour;
        ctx.lineWidth = thick;
        line([a, b]);
        ctx.stroke();
      }
      ctx.restore();
      return;
    } else {
      line([place(length, w / 2), place(0, w / 2), place(0, -w / 2), place(length, -w / 2)]);
      if (shape === "box") { ctx.closePath(); ctx.fill(); }
    }
    ctx.stroke();
    ctx.restore();
  }
}
