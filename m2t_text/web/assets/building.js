// The building: the walls of all datasets, each in its own frame, and every place; pan, zoom, point, click.
// Walls and places are written into pixels one by one, which takes milliseconds for a hundred thousand of them.

import { scaleBar, Surface } from "./canvas.js";
import { colour, pixel, whenThemed } from "./theme.js";
import { coarser, layOut } from "./layout.js";
import { drawMarks } from "./marks.js";

const NEAR = 12; // pixels within which a place is pointed at
const MEANT = 2; // metres; a click so near to a place means it
const SHADES = 8;

export class Building {
  constructor(canvas, { pointed, picked }) {
    this.canvas = canvas;
    this.pointed = pointed;
    this.picked = picked;
    this.frames = []; // {name, begin, end, box, x, y: where its frame lies, hidden, walls: [levels]}
    this.marks = {};
    this.over = this.cursor = -1;
    this.view = { x: 0, y: 0, scale: 20 };
    this.frameTimes = [];
    this.surface = new Surface(canvas, (context, resized) => this.paint(context, resized));
    this.listen();
    whenThemed(() => { this.shades = null; this.surface.redraw(); });
  }

  // Places as `/api/places` gives them.
  setPlaces(places) {
    const before = new Map(this.frames.map((frame) => [frame.name, frame]));
    this.places = places;
    this.frames = places.datasets.map((dataset) => {
      const { walls = null, floor = null, hidden = false, extent = null } = before.get(dataset.name) || {};
      return { ...dataset, walls, floor, hidden, extent };
    });
    this.wx = new Float32Array(places.maps);
    this.wy = new Float32Array(places.maps);
    this.dim = new Uint8Array(places.maps);
    this.lay();
  }

  // A dataset that is not in the index: an upload, in a frame of its own.
  setGuest(guest) {
    this.guest = guest;
    this.lay();
    this.surface.redraw();
  }

  lay() {
    const before = JSON.stringify(this.all().map((frame) => [frame.name, frame.box, !!frame.hidden]));
    layOut(this.all().filter((frame) => !frame.hidden), this.surface.width / this.surface.height);
    const { places } = this;
    for (const frame of this.frames) {
      for (let k = frame.begin; k < frame.end; k++) {
        this.wx[k] = places.x[k] + frame.x;
        this.wy[k] = places.y[k] + frame.y;
      }
    }
    if (before !== this.laid) this.fit();
    this.laid = before;
    this.surface.redraw();
  }

  all() { return this.guest ? [...this.frames, this.guest] : this.frames; }

  frame(name) { return this.all().find((frame) => frame.name === name && !frame.hidden); }

  // Walls as `/api/walls` gives them, and coarser copies for a look from afar.
  setWalls(name, walls) {
    const frame = this.all().find((one) => one.name === name);
    if (!frame) return;
    frame.walls = [walls];
    frame.floor = [{ x: walls.floor_x, y: walls.floor_y, seen: new Uint8Array(walls.floor_x.length).fill(1), cell: walls.floor_cell, origin: walls.origin }];
    while (frame.floor.length < 5 && frame.floor.at(-1).x.length > 400) frame.floor.push(coarser(frame.floor.at(-1)));
    while (frame.walls.length < 6 && frame.walls.at(-1).x.length > 400) frame.walls.push(coarser(frame.walls.at(-1)));
    frame.extent = extent(walls) || frame.box;
    if (this.goal && !this.byHand) this.focus(this.goal);
    this.surface.redraw();
  }

  hide(names) {
    for (const frame of this.frames) frame.hidden = names.has(frame.name);
    this.lay();
  }

  // Which places are pale: those outside a range of travel, or not found. `found` is an array of numbers or null.
  filter(from, to, found) {
    const { places } = this;
    if (!places) return;
    this.dim.fill(0);
    this.matching = found;
    const sought = found && new Set(found);
    for (let k = 0; k < places.maps; k++) {
      if (places.travel[k] < from || places.travel[k] > to) this.dim[k] = 1;
      else if (sought) this.dim[k] = sought.has(k) ? 2 : 1;
    }
    this.surface.redraw();
  }

  mark(marks) {
    Object.assign(this.marks, marks);
    this.surface.redraw();
  }

  // Where a pose of a dataset lies in the picture's plane; null if the dataset is not shown.
  locate(name, pose) {
    const frame = this.frame(name);
    return frame && pose ? [pose[0] + frame.x, pose[1] + frame.y, pose[2]] : null;
  }

  placeNumber(name, scan) {
    const frame = this.frames.find((one) => one.name === name);
    if (!frame) return -1;
    const scans = this.places.first_scan;
    let low = frame.begin, high = frame.end;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (scans[middle] < scan) low = middle + 1; else high = middle;
    }
    return low < frame.end && scans[low] === scan ? low : -1;
  }

  placeId(number) {
    if (number < 0) return null;
    const frame = this.frames.find((one) => number >= one.begin && number < one.end);
    return `${frame.name}/${String(this.places.first_scan[number]).padStart(6, "0")}`;
  }

  // Shows some datasets, all if none are given, as large as possible; also when their walls are known.
  fit(shown = this.all().filter((frame) => !frame.hidden)) {
    if (!shown.length) return;
    this.byHand = false;
    const boxes = shown.map((frame) => (frame.extent || frame.box).map((value, k) => value + (k % 2 ? frame.y : frame.x)));
    const [x0, y0] = [0, 1].map((k) => Math.min(...boxes.map((box) => box[k])));
    const [x1, y1] = [2, 3].map((k) => Math.max(...boxes.map((box) => box[k])));
    this.goal = shown.map((frame) => frame.name);
    const { width, height } = this.surface;
    const scale = Math.min((width - 40) / (x1 - x0), (height - 80) / (y1 - y0));
    this.fitted = Math.min(this.fitted || scale, scale);
    this.view = { x: (x0 + x1) / 2, y: (y0 + y1) / 2, scale };
    this.surface.redraw();
  }

  // Brings some datasets into view, as large as possible.
  focus(names) {
    const wanted = this.all().filter((frame) => !frame.hidden && names.includes(frame.name));
    if (wanted.length) this.fit(wanted);
  }

  toScreen(x, y) {
    const { width, height } = this.surface, { view } = this;
    return [width / 2 + (x - view.x) * view.scale, height / 2 - (y - view.y) * view.scale];
  }

  toWorld(px, py) {
    const { width, height } = this.surface, { view } = this;
    return [view.x + (px - width / 2) / view.scale, view.y - (py - height / 2) / view.scale];
  }

  // The number of the place nearest to a pixel, -1 if none is near.
  pick(px, py, reach = NEAR) {
    if (!this.places) return -1;
    const [x, y] = this.toWorld(px, py);
    let best = -1, least = (reach / this.view.scale) ** 2;
    const { wx, wy, dim } = this;
    for (const frame of this.frames) {
      if (frame.hidden) continue;
      for (let k = frame.begin; k < frame.end; k++) {
        const away = (wx[k] - x) ** 2 + (wy[k] - y) ** 2;
        if (away < least && dim[k] !== 1) { best = k; least = away; }
      }
    }
    return best;
  }

  pickGuest(px, py) {
    if (!this.guest || !this.guest.places) return -1;
    const [x, y] = this.toWorld(px, py), { places } = this.guest;
    let best = -1, least = (NEAR / this.view.scale) ** 2;
    for (let k = 0; k < places.maps; k++) {
      const away = (places.place_x[k] + this.guest.x - x) ** 2 + (places.place_y[k] + this.guest.y - y) ** 2;
      if (away < least) { best = k; least = away; }
    }
    return best;
  }

  zoom(factor, px = this.surface.width / 2, py = this.surface.height / 2) {
    const [x, y] = this.toWorld(px, py), { view } = this;
    const scale = Math.min(400, Math.max((this.fitted || 1) / 3, view.scale * factor));
    view.x = x - (x - view.x) * view.scale / scale;
    view.y = y - (y - view.y) * view.scale / scale;
    view.scale = scale;
    this.surface.redraw();
  }

  pan(dx, dy) {
    this.view.x -= dx / this.view.scale;
    this.view.y += dy / this.view.scale;
    this.surface.redraw();
  }

  // Brings a place into view, if it is not.
  reveal(point) {
    if (!point) return;
    const [px, py] = this.toScreen(point[0], point[1]), { width, height } = this.surface;
    if (px < 40 || py < 40 || px > width - 40 || py > height - 40) {
      [this.view.x, this.view.y] = point;
      this.surface.redraw();
    }
  }

  // --- Drawing

  paint(context, resized) {
    const begin = performance.now();
    const { canvas } = this;
    if (resized || !this.image) {
      this.image = context.createImageData(canvas.width, canvas.height);
      this.pixels = new Uint32Array(this.image.data.buffer);
      if (this.places && !this.moved) this.lay();
    }
    this.shades ||= this.mix();
    this.pixels.fill(this.shades.ground);
    const seen = this.all().filter((frame) => this.isSeen(frame));
    for (const frame of seen) if (frame.floor) this.paintCells(frame, frame.floor, this.shades.floor);
    for (const frame of seen) if (frame.walls) this.paintCells(frame, frame.walls, this.shades.walls);
    for (const frame of seen) if (!frame.guest) this.paintPlaces(frame);
    context.putImageData(this.image, 0, 0);
    drawMarks(this, context);
    if (this.places && this.places.maps) scaleBar(context, this.view.scale, 14, this.surface.height - 12, colour.soft);
    if (this.places && this.places.maps && !this.pictured) { this.pictured = true; performance.mark("first picture"); }
    this.frameTimes.push(performance.now() - begin);
    if (this.frameTimes.length > 600) this.frameTimes.shift();
  }

  // Whether any of a dataset lies within the picture.
  isSeen(frame) {
    if (frame.hidden || frame.x === undefined) return false;
    const [left, bottom] = this.toScreen(frame.x + frame.box[0], frame.y + frame.box[1]);
    const [right, top] = this.toScreen(frame.x + frame.box[2], frame.y + frame.box[3]);
    return right > 0 && left < this.surface.width && bottom > 0 && top < this.surface.height;
  }

  mix() {
    const walls = [...Array(SHADES).keys()].map((k) => pixel(colour["wall-pale"], colour.wall, Math.min(1, k / 4)));
    return {
      ground: pixel(colour.bg, colour.bg, 0), walls, floor: Array(SHADES).fill(pixel(colour.floor, colour.floor, 0)), place: pixel(colour.place, colour.place, 0),
      pale: pixel(colour.bg, colour.place, 0.35), found: pixel(colour.find, colour.find, 0),
    };
  }

  paintCells(frame, levels, shades) {
    const { ratio } = this.surface, scale = this.view.scale * ratio;
    const level = levels.find((one) => one.cell * scale >= 0.8) || levels.at(-1);
    const { x, y, seen, cell, origin } = level;
    const { width, height } = this.canvas, { pixels } = this;
    const step = cell * scale, side = Math.max(1, Math.ceil(step - 0.01));
    const left = width / 2 + (origin[0] + frame.x - this.view.x) * scale;
    const top = height / 2 - (origin[1] + frame.y - this.view.y) * scale - side;
    for (let k = 0; k < x.length; k++) {
      const px = (left + x[k] * step) | 0, py = (top - y[k] * step) | 0;
      if (px < 0 || py < 0 || px + side > width || py + side > height) continue;
      square(pixels, py * width + px, width, side, shades[seen[k] < SHADES ? seen[k] - 1 : SHADES - 1]);
    }
  }

  paintPlaces(frame) {
    const { ratio } = this.surface, scale = this.view.scale * ratio;
    const { width, height } = this.canvas, { pixels, wx, wy, dim } = this, { place, pale, found } = this.shades;
    const small = Math.max(Math.round(ratio * (this.places.maps < 20000 ? 2 : 1)), Math.round(Math.min(5, this.view.scale / 9) * ratio));
    const large = small + Math.round(3 * ratio);
    for (let pass = 0; pass < (this.matching ? 2 : 1); pass++) {
      for (let k = frame.begin; k < frame.end; k++) {
        const kind = dim[k];
        if ((kind === 2) !== (pass === 1)) continue;
        const side = pass ? large : small;
        const px = (width / 2 + (wx[k] - this.view.x) * scale - side / 2) | 0;
        const py = (height / 2 - (wy[k] - this.view.y) * scale - side / 2) | 0;
        if (px < 0 || py < 0 || px + side > width || py + side > height) continue;
        square(pixels, py * width + px, width, side, kind === 2 ? found : kind === 1 ? pale : place);
      }
    }
  }

  // --- Pointer and keyboard

  listen() {
    const { canvas } = this, pointers = new Map();
    let dragged = 0, apart = 0;
    const at = (event) => { const box = canvas.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, at(event));
      dragged = 0;
      apart = 0;
    });
    canvas.addEventListener("pointermove", (event) => {
      const now = at(event), before = pointers.get(event.pointerId);
      if (!before) { this.point(...now); return; }
      pointers.set(event.pointerId, now);
      if (pointers.size === 2) {
        const [a, b] = [...pointers.values()], away = Math.hypot(a[0] - b[0], a[1] - b[1]);
        if (apart) this.zoom(away / apart, (a[0] + b[0]) / 2, (a[1] + b[1]) / 2);
        apart = away;
        dragged = 99;
        return;
      }
      dragged += Math.hypot(now[0] - before[0], now[1] - before[1]);
      if (dragged > 4) {
        this.moved = this.byHand = true;
        canvas.classList.add("moving");
        this.pan(now[0] - before[0], now[1] - before[1]);
      }
    });
    const up = (event) => {
      const now = pointers.get(event.pointerId);
      pointers.delete(event.pointerId);
      canvas.classList.remove("moving");
      if (now && event.type === "pointerup" && dragged <= 4) this.choose(...now, event);
    };
    canvas.addEventListener("pointerup", up);
    canvas.addEventListener("pointercancel", up);
    canvas.addEventListener("pointerleave", () => this.point(-1e6, -1e6));
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.moved = this.byHand = true;
      this.zoom(Math.exp(-event.deltaY * (event.ctrlKey ? 0.01 : 0.0018)), ...at(event));
    }, { passive: false });
    canvas.addEventListener("dblclick", (event) => this.zoom(1.6, ...at(event)));
    canvas.addEventListener("keydown", (event) => this.key(event));
  }

  point(px, py) {
    const guest = this.pickGuest(px, py), number = guest >= 0 ? -1 : this.pick(px, py);
    this.canvas.classList.toggle("over", number >= 0 || guest >= 0);
    if (number === this.over && guest === this.overGuest) return;
    [this.over, this.overGuest] = [number, guest];
    this.surface.redraw();
    this.pointed(number, guest, px, py);
  }

  choose(px, py, event) {
    const reach = Math.max(24, MEANT * this.view.scale);
    const guest = this.pickGuest(px, py), number = guest >= 0 ? -1 : this.pick(px, py, reach);
    if (number >= 0 || guest >= 0) this.picked(number, guest, event.shiftKey);
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const step = 60, moves = { ArrowLeft: [step, 0], ArrowRight: [-step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] };
    if (moves[event.key]) { this.moved = this.byHand = true; this.pan(...moves[event.key]); }
    else if (event.key === "+" || event.key === "=") this.zoom(1.3);
    else if (event.key === "-") this.zoom(1 / 1.3);
    else if (event.key === "0") { this.fit(); this.moved = false; }
    else if (event.key === "[" || event.key === "]") this.next(event.key === "]" ? 1 : -1);
    else if ((event.key === "Enter" || event.key === " ") && this.cursor >= 0) this.picked(this.cursor, -1, event.shiftKey);
    else return;
    event.preventDefault();
  }

  // Moves the cursor of the keyboard along the drives.
  next(by) {
    if (!this.places || !this.places.maps) return;
    let number = this.cursor ?? -1;
    if (number < 0) number = this.pick(this.surface.width / 2, this.surface.height / 2, 1e6) - by;
    for (let tries = 0; tries < this.places.maps; tries++) {
      number = (number + by + this.places.maps) % this.places.maps;
      const frame = this.frames.find((one) => number >= one.begin && number < one.end);
      if (!frame.hidden && this.dim[number] !== 1) break;
    }
    this.cursor = number;
    this.reveal([this.wx[number], this.wy[number]]);
    this.surface.redraw();
    this.pointed(number, -1, ...this.toScreen(this.wx[number], this.wy[number]));
  }
}

// The box that holds the cells of walls, in metres, without those few that lie far out; null if there are none.
function extent({ x, y, cell, origin }) {
  if (!x.length) return null;
  const [xs, ys] = [x, y].map((values) => values.slice().sort());
  const at = (values, share) => values[Math.floor((values.length - 1) * share)] * cell;
  const low = 0.002, high = 1 - low;
  return [origin[0] + at(xs, low) - 1, origin[1] + at(ys, low) - 1, origin[0] + at(xs, high) + 1, origin[1] + at(ys, high) + 1];
}

// Fills a square of pixels, whose first is number `at` of rows of so many.
function square(pixels, at, width, side, shade) {
  for (let row = 0; row < side; row++, at += width) {
    for (let k = 0; k < side; k++) pixels[at + k] = shade;
  }
}
