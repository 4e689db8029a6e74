// What all canvases share: as many pixels as the screen has, and drawing once a frame.

export class Surface {
  constructor(canvas, draw) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.draw = draw;
    this.waiting = false;
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.resize();
  }

  resize() {
    const box = this.canvas.getBoundingClientRect();
    this.ratio = Math.min(devicePixelRatio || 1, 2);
    this.width = Math.max(1, Math.round(box.width));
    this.height = Math.max(1, Math.round(box.height));
    this.canvas.width = Math.round(this.width * this.ratio);
    this.canvas.height = Math.round(this.height * this.ratio);
    this.redraw(true);
  }

  redraw(resized = false) {
    this.resized ||= resized;
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      const again = this.resized;
      this.resized = false;
      this.context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
      this.draw(this.context, again);
    });
  }
}

export function arrow(context, x, y, angle, length, fill, edge) {
  context.save();
  context.translate(x, y);
  context.rotate(-angle);
  context.beginPath();
  context.moveTo(length, 0);
  context.lineTo(-length * 0.62, length * 0.6);
  context.lineTo(-length * 0.28, 0);
  context.lineTo(-length * 0.62, -length * 0.6);
  context.closePath();
  context.fillStyle = fill;
  context.fill();
  context.lineWidth = 1.5;
  context.strokeStyle = edge;
  context.stroke();
  context.restore();
}

export function cross(context, x, y, size) {
  context.moveTo(x - size, y - size);
  context.lineTo(x + size, y + size);
  context.moveTo(x - size, y + size);
  context.lineTo(x + size, y - size);
}

// The scale bar of a picture: a round number of metres, about a hundred pixels long.
export function scaleBar(context, scale, x, y, ink) {
  const most = 110 / scale;
  const power = 10 ** Math.floor(Math.log10(most));
  const metres = [5, 2, 1].map((k) => k * power).find((length) => length <= most) || power;
  const length = metres * scale;
  context.strokeStyle = context.fillStyle = ink;
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(x, y - 4); context.lineTo(x, y); context.lineTo(x + length, y); context.lineTo(x + length, y - 4);
  context.stroke();
  context.font = "11px system-ui, sans-serif";
  context.textAlign = "left";
  context.textBaseline = "bottom";
  context.fillText(metres >= 1000 ? `${metres / 1000} km` : `${metres} m`, x + 5, y - 2);
}
