// One or two maps in a panel, in the frame of the viewpoint of the one that stands still: keypoints, free squares,
// viewpoints. Metres; x to the right, y up.

import { arrow, cross, scaleBar, Surface } from "./canvas.js";
import { mover } from "./geometry.js";
import { colour, whenThemed } from "./theme.js";

const ALONE = "0", SHARED = "2", CONFLICTS = "3";

export class MapView {
  // `pointed` is called with the keypoint of the laid map under the pointer, or null.
  constructor(canvas, pointed = null) {
    this.layers = [];
    this.cell = 0.1;
    this.radii = [];
    this.lit = null;
    this.found = new Set();
    this.surface = new Surface(canvas, (context) => this.paint(context));
    whenThemed(() => this.surface.redraw());
    if (pointed) this.listen(canvas, pointed);
  }

  // Layers from the back to the front: {text, pose, colour name, status: a digit for each keypoint, or null}.
  set(layers, cell) {
    this.layers = layers.map((layer) => ({ ...layer, points: placed(layer, cell) }));
    this.cell = cell;
    this.lit = null;
    const all = this.layers.flatMap((layer) => layer.points);
    const xs = all.map((p) => p[0]).concat(-1, 1), ys = all.map((p) => p[1]).concat(-1, 1);
    this.box = [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
    this.surface.redraw();
  }

  light(index) {
    if (index === this.lit) return;
    this.lit = index;
    this.surface.redraw();
  }

  listen(canvas, pointed) {
    canvas.addEventListener("pointermove", (event) => {
      const box = canvas.getBoundingClientRect();
      pointed(this.near(event.clientX - box.left, event.clientY - box.top));
    });
    canvas.addEventListener("pointerleave", () => pointed(null));
  }

  // The number of the keypoint of the front layer near a pixel, or null.
  near(px, py) {
    const layer = this.layers.at(-1);
    if (!layer || !this.project) return null;
    let best = null, least = 14 * 14;
    layer.points.forEach(([x, y], number) => {
      const [a, b] = this.project(x, y);
      const away = (a - px) ** 2 + (b - py) ** 2;
      if (away < least) [best, least] = [number, away];
    });
    return best;
  }

  paint(context) {
    const { width, height } = this.surface;
    context.fillStyle = colour.panel;
    context.fillRect(0, 0, width, height);
    if (!this.layers.length) return;
    const [x0, y0, x1, y1] = this.box, margin = 22;
    const scale = Math.min((width - 2 * margin) / (x1 - x0), (height - 2 * margin) / (y1 - y0));
    const cx = (x0 + x1) / 2, cy = (y0 + y1) / 2;
    this.project = (x, y) => [width / 2 + (x - cx) * scale, height / 2 - (y - cy) * scale];
    this.grid(context, scale);
    for (const layer of this.layers) this.squares(context, layer, scale);
    for (const layer of this.layers) this.keypoints(context, layer, scale);
    for (const layer of this.layers) {
      const [x, y] = this.project(layer.pose[0], layer.pose[1]);
      arrow(context, x, y, layer.pose[2], 11, colour[layer.colour], colour.panel);
    }
    this.rings(context, scale);
    scaleBar(context, scale, 12, height - 10, colour.soft);
  }

  grid(context, scale) {
    const step = scale > 12 ? 1 : 5;
    const [x0, y0, x1, y1] = this.box.map((v, k) => (k < 2 ? Math.floor(v / step - 1) : Math.ceil(v / step + 1)) * step);
    context.beginPath();
    for (let x = x0; x <= x1; x += step) { context.moveTo(...this.project(x, y0)); context.lineTo(...this.project(x, y1)); }
    for (let y = y0; y <= y1; y += step) { context.moveTo(...this.project(x0, y)); context.lineTo(...this.project(x1, y)); }
    context.strokeStyle = colour.grid;
    context.lineWidth = 1;
    context.stroke();
  }

  squares(context, layer, scale) {
    if (!layer.text.squares.length) return;
    const move = mover(layer.pose), cell = this.cell;
    context.fillStyle = colour.free;
    context.strokeStyle = colour.free;
    context.lineWidth = 0.6;
    context.beginPath();
    for (const { x, y, value } of layer.text.squares) {
      const corners = [[x, y], [x + value, y], [x + value, y + value], [x, y + value]];
      corners.forEach(([a, b], k) => {
        const point = this.project(...move(a * cell, b * cell));
        if (k) context.lineTo(...point); else context.moveTo(...point);
      });
      context.closePath();
    }
    context.fill();
    context.stroke();
  }

  keypoints(context, layer, scale) {
    const size = Math.max(2.4, this.cell * scale * 0.92), half = size / 2;
    const crosses = [];
    layer.points.forEach(([x, y], number) => {
      const status = layer.status ? layer.status[number] : ALONE;
      const [a, b] = this.project(x, y);
      if (status === CONFLICTS) { crosses.push([a, b]); return; }
      const keypoint = layer.text.keypoints[number];
      context.globalAlpha = layer.status && status === ALONE ? 0.45 : 1;
      context.fillStyle = this.found.has(keypoint) ? colour.find : status === SHARED ? colour.shared : colour[layer.colour];
      const wide = this.found.has(keypoint) ? half + 2 : half;
      context.fillRect(a - wide, b - wide, 2 * wide, 2 * wide);
    });
    context.globalAlpha = 1;
    context.beginPath();
    crosses.forEach(([a, b]) => cross(context, a, b, Math.max(3, half + 1)));
    context.strokeStyle = colour.conflict;
    context.lineWidth = 1.8;
    context.stroke();
  }

  // The rings about the keypoint that is lit: filled those whose bits make up its word.
  rings(context, scale) {
    const layer = this.layers.at(-1);
    if (this.lit === null || !layer.points[this.lit]) return;
    const keypoint = layer.text.keypoints[this.lit];
    const [x, y] = this.project(...layer.points[this.lit]);
    let inner = 0;
    this.radii.forEach((radius, bit) => {
      context.beginPath();
      context.arc(x, y, radius * scale, 0, 2 * Math.PI);
      context.arc(x, y, inner * scale, 0, 2 * Math.PI, true);
      if ((keypoint.value >> bit) & 1) {
        context.globalAlpha = 0.22;
        context.fillStyle = colour[layer.colour];
        context.fill();
      }
      context.globalAlpha = 0.55;
      context.strokeStyle = colour.soft;
      context.lineWidth = 0.8;
      context.stroke();
      inner = radius;
    });
    context.globalAlpha = 1;
    context.beginPath();
    context.arc(x, y, 5, 0, 2 * Math.PI);
    context.strokeStyle = colour.ink;
    context.lineWidth = 2.5;
    context.stroke();
  }
}

function placed(layer, cell) {
  const move = mover(layer.pose);
  return layer.text.keypoints.map(({ x, y }) => move((x + 0.5) * cell, (y + 0.5) * cell));
}
