"use strict";
// The rotary pendulum in perspective.  The arm turns by θ about the vertical axis z; at its end the pendulum turns by α
// about the arm.  With e_r along the arm and e_t = z × e_r,
//   tip = l₁ e_r + L (sin α e_t ± cos α z),   + where α = 0 is upright, − where it hangs;
// the sign of sin α is that of C₃ cos α in the mass matrix, with C₃ > 0.

const RAD = Math.PI / 180;

class Camera {
  constructor() {
    this.azimuth = -0.9;
    this.elevation = 0.42;
  }

  // World [m] → screen [px] and depth; r is the radius of all that is to be seen.
  project([x, y, z], size, r) {
    const ca = Math.cos(this.azimuth), sa = Math.sin(this.azimuth), ce = Math.cos(this.elevation), se = Math.sin(this.elevation);
    const right = ca * x - sa * y, back = sa * x + ca * y;
    const up = ce * z + se * back, depth = ce * back - se * z;
    const D = 4 * r, scale = size * 0.47 * Math.sqrt(D * D - r * r) / r / (D + depth);
    return { x: scale * right, y: -scale * up, scale, depth };
  }
}

class Rig {
  constructor(canvas, lengths, camera) {
    Object.assign(this, { canvas, lengths, camera });
    this.column = 1.08 * lengths.pendulum;
    this.frame([[0, 0]]);
  }

  of() {}

  // Put into the picture all that is reached: from the foot up to the highest tip.
  frame(poses) {
    const { arm, pendulum } = this.lengths;
    const top = poses.reduce((high, [, a]) => Math.max(high, this.pose(0, a).tip[2]), 0.12 * pendulum);
    this.middle = (top - this.column) / 2;
    this.radius = 1.06 * Math.hypot(arm, (top + this.column) / 2);
  }

  // Ends of arm and pendulum [m] at θ and α [°].
  pose(theta, alpha) {
    const { arm, pendulum, zero } = this.lengths, t = theta * RAD, a = alpha * RAD;
    const up = (zero === "upright" ? 1 : -1) * pendulum * Math.cos(a), side = pendulum * Math.sin(a);
    const c = Math.cos(t), s = Math.sin(t), end = [arm * c, arm * s, 0];
    return { end, tip: [end[0] - side * s, end[1] + side * c, up] };
  }

  // The rig as simulated, with a ghost where it was measured: each [θ, α] in degrees.
  draw(simulated, measured, trail) {
    const { canvas } = this, ratio = devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const ctx = this.ctx = canvas.getContext("2d");
    ctx.setTransform(ratio, 0, 0, ratio, ratio * width / 2, ratio * height / 2);
    ctx.clearRect(-width / 2, -height / 2, width, height);
    this.size = Math.min(width, height);
    ctx.lineCap = "round";
    const { end, tip } = this.pose(...simulated), floor = -this.column;
    this.floor(floor, end, tip);
    this.dial(simulated[0]);
    this.path(trail);
    this.ghost(this.pose(...measured));
    const parts = [
      [[0, 0, floor / 2], () => this.bar([0, 0, floor], [0, 0, 0], 0.05, css("metal"), css("metal-dark"))],
      [end.map(v => 0.55 * v), () => this.bar([0, 0, 0], end, 0.035, css("metal"), css("metal-dark"))],
      [end.map((v, k) => 0.45 * v + 0.55 * tip[k]), () => this.pendulum(end, tip)],
    ];
    for (const [, paint] of parts.map(([middle, paint]) => [this.at(middle).depth, paint]).sort((a, b) => b[0] - a[0])) paint();
  }

  // Broader and pale, so that it shows as a rim where the two agree.
  ghost({ end, tip }) {
    this.ctx.globalAlpha = 0.55;
    this.bar([0, 0, 0], end, 0.062, css("ghost"), css("ghost"));
    this.bar(end, tip, 0.056, css("ghost"), css("ghost"));
    this.ctx.globalAlpha = 1;
  }

  at([x, y, z]) { return this.camera.project([x, y, z - this.middle], this.size, this.radius); }

  bar(from, to, thickness, fill, edge) {
    const { ctx } = this, a = this.at(from), b = this.at(to), width = thickness * this.radius * (a.scale + b.scale) / 2;
    for (const [w, colour] of [[width + 2, edge], [width, fill]]) {
      ctx.strokeStyle = colour;
      ctx.lineWidth = w;
      ctx.beginPath();
      ctx.moveTo(a.x, a.y);
      ctx.lineTo(b.x, b.y);
      ctx.stroke();
    }
  }

  pendulum(end, tip) {
    const { ctx } = this, pivot = this.at(end);
    this.bar(end, tip, 0.026, css("bob"), css("metal-dark"));
    ctx.fillStyle = css("metal-dark");
    ctx.beginPath();
    ctx.arc(pivot.x, pivot.y, 0.024 * this.radius * pivot.scale, 0, 7);
    ctx.fill();
  }

  floor(z, end, tip) {
    const { ctx } = this, shadow = p => [p[0], p[1], z];
    ctx.fillStyle = css("paper");
    ctx.strokeStyle = css("line");
    ctx.lineWidth = 1;
    this.ring(0.5 * this.lengths.arm, z);
    ctx.fill();
    ctx.stroke();
    ctx.strokeStyle = css("shadow");
    ctx.lineWidth = 0.03 * this.radius * this.at([0, 0, z]).scale;
    ctx.beginPath();
    for (const p of [[0, 0, 0], end, tip]) { const s = this.at(shadow(p)); ctx.lineTo(s.x, s.y); }
    ctx.stroke();
  }

  // The arm's circle with its zero, and a sector up to θ.
  dial(theta) {
    const { ctx } = this, { arm } = this.lengths;
    ctx.strokeStyle = css("line");
    ctx.lineWidth = 1;
    this.ring(arm, 0);
    ctx.stroke();
    ctx.strokeStyle = css("soft");
    ctx.beginPath();
    for (const f of [0.8, 1.06]) { const p = this.at([f * arm, 0, 0]); ctx.lineTo(p.x, p.y); }
    ctx.stroke();
    ctx.fillStyle = css("window");
    ctx.beginPath();
    const centre = this.at([0, 0, 0]);
    ctx.moveTo(centre.x, centre.y);
    for (let k = 0; k <= 24; k++) { const a = theta * RAD * k / 24, p = this.at([0.8 * arm * Math.cos(a), 0.8 * arm * Math.sin(a), 0]); ctx.lineTo(p.x, p.y); }
    ctx.fill();
  }

  ring(r, z) {
    const { ctx } = this;
    ctx.beginPath();
    for (let k = 0; k <= 60; k++) { const a = k * Math.PI / 30, p = this.at([r * Math.cos(a), r * Math.sin(a), z]); ctx.lineTo(p.x, p.y); }
  }

  // Where the tip was a moment ago.
  path(trail) {
    const { ctx } = this;
    ctx.strokeStyle = css("bob");
    ctx.lineWidth = 1.5;
    for (let k = 1; k < trail.length; k++) {
      const [a, b] = [trail[k - 1], trail[k]].map(([t, al]) => this.at(this.pose(t, al).tip));
      ctx.globalAlpha = 0.6 * k / trail.length;
      ctx.beginPath();
      ctx.moveTo(a.x, a.y);
      ctx.lineTo(b.x, b.y);
      ctx.stroke();
    }
    ctx.globalAlpha = 1;
  }
}

// Either drawing of the page's model, or null where its curves are all.
const drawing = canvas => DATA.rig && (DATA.rig.bodies ? new Scene(canvas, DATA.rig) : new Rig(canvas, DATA.rig, new Camera()));

// What a drawing is drawn from: of each of its outputs the value, as the drawing counts it.
const posture = (recording, value) => DATA.rig.outputs.map(o => value(o.name) / o.factor - (o.rest[recording] || 0));
