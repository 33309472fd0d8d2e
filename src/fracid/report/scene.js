"use strict";
// The scene of a model: bodies in a plane or in space, each from one point to another (fracid.models.scene).
// `scenePose`, written from the model's own text, makes of the constants a function of the outputs that fills the
// coordinates of all ends.

class Scene {
  constructor(canvas, said) {
    Object.assign(this, { canvas, bodies: said.bodies, constants: said.constants, dimension: said.dimension, made: said.made });
    this.camera = said.dimension === 3 ? { azimuth: -1.1, elevation: 0.42 } : null;
    this.ends = new Float64Array(2 * this.dimension * this.bodies.length);
    this.of(Object.keys(said.constants)[0]);
    this.frame([said.outputs.map(() => 0)]);
  }

  // Its constants in one recording.
  of(recording) { this.pose = (this.made || scenePose)(this.constants[recording]); }

  // Turned by the pointer, where it is in space.
  turnable(show) {
    const { canvas, camera } = this;
    if (!camera) return;
    canvas.addEventListener("pointerdown", e => canvas.setPointerCapture(e.pointerId));
    canvas.addEventListener("pointermove", e => {
      if (!canvas.hasPointerCapture(e.pointerId)) return;
      camera.azimuth += 0.008 * e.movementX;
      camera.elevation = Math.min(Math.max(camera.elevation + 0.006 * e.movementY, -0.2), 1.5);
      show();
    });
  }

  at(values) {
    this.pose(values, [], this.ends);
    const n = this.dimension, point = k => [...this.ends.slice(n * k, n * k + n)];
    return this.bodies.map((body, k) => ({ ...body, from: point(2 * k), to: point(2 * k + 1) }));
  }

  // Put into the picture all that is reached: of a scene in space from wherever it is looked at.
  frame(poses) {
    const axes = [...Array(this.dimension).keys()], low = axes.map(() => Infinity), high = axes.map(() => -Infinity);
    for (const values of poses) {
      for (const { from, to, width, shape } of this.at(values)) {
        const reach = shape === "disc" ? Math.hypot(...to.map((v, k) => v - from[k])) : this.camera ? 0 : width / 2;
        for (const point of shape === "disc" ? [from] : [from, to]) for (const k of axes) {
          if (!Number.isFinite(point[k])) continue;
          low[k] = Math.min(low[k], point[k] - reach);
          high[k] = Math.max(high[k], point[k] + reach);
        }
      }
    }
    this.middle = axes.map(k => (low[k] + high[k]) / 2);
    this.floor = low.at(-1);
    const size = axes.map(k => high[k] - low[k]), round = Math.hypot(...size);
    this.size = this.camera ? [round, round] : size;
  }

  draw(simulated, measured, trail) {
    const { canvas, size } = this, ratio = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    const ctx = this.ctx = canvas.getContext("2d");
    this.scale = 0.9 * Math.min(width / size[0], height / size[1]);
    ctx.setTransform(ratio, 0, 0, ratio, ratio * width / 2, ratio * height / 2);
    ctx.lineJoin = "round";
    const bodies = this.at(simulated);
    if (this.camera) this.shadow(bodies);
    this.path(trail);
    for (const body of this.at(measured)) if (body.moves) this.body(body, true);
    const away = ({ from, to }) => this.seen(from)[2] + this.seen(to)[2];
    for (const body of bodies.sort((a, b) => away(b) - away(a))) this.body(body, false);
  }

  // To the right, up and away from the reader, from the middle; in a plane nothing is farther than another.
  seen(point) {
    const [x, y, z] = point.map((v, k) => v - this.middle[k]);
    if (!this.camera) return [x, y, 0];
    const { azimuth, elevation } = this.camera, ca = Math.cos(azimuth), sa = Math.sin(azimuth), ce = Math.cos(elevation), se = Math.sin(elevation);
    const back = sa * x + ca * y;
    return [ca * x - sa * y, ce * z + se * back, ce * back - se * z];
  }

  px(point) { const [x, y] = this.seen(point); return [this.scale * x, -this.scale * y]; }

  stroke(points, colour, width) {
    const { ctx } = this;
    ctx.strokeStyle = css(colour);
    ctx.lineWidth = width;
    ctx.beginPath();
    for (const point of points) ctx.lineTo(...this.px(point));
    ctx.stroke();
  }

  shadow(bodies) {
    const below = ([x, y]) => [x, y, this.floor];
    this.ctx.lineCap = "round";
    for (const { from, to, width } of bodies) this.stroke([below(from), below(to)], "shadow", this.scale * width);
  }

  // Where the last body that moves ended a moment ago.
  path(trail) {
    const last = this.bodies.findLastIndex(body => body.moves), ends = trail.map(values => this.at(values)[last].to);
    for (let k = 1; k < ends.length; k++) {
      this.ctx.globalAlpha = 0.6 * k / ends.length;
      this.stroke([ends[k - 1], ends[k]], "bob", 1.5);
    }
    this.ctx.globalAlpha = 1;
  }

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

// The drawing of the page's model, or null where its curves are all.
const drawing = canvas => DATA.rig && new Scene(canvas, DATA.rig);

// What a drawing is drawn from: of each of its outputs the value, as the model counts it.
const posture = value => DATA.rig.outputs.map(o => value(o.name) / o.factor);
