// A drive looked up place by place: from the server as it is computed, shown at the speed that is asked for.

import { show, shown } from "./address.js";
import { json } from "./api.js";
import { Surface } from "./canvas.js";
import { by, percent, say, sure, thousands } from "./elements.js";
import { colour, whenThemed } from "./theme.js";

const TALL = { match: 1, ambiguous: 0.62, none: 0.3 };
const REFRESH = 700; // ms from one look at the walls of a drive that is being read to the next

export class Replay {
  constructor(page) {
    this.page = page;
    this.places = [];
    this.at = -1;
    this.track = new Surface(by("track"), (context) => this.paint(context));
    whenThemed(() => this.track.redraw());
    by("play").addEventListener("click", () => this.toggle());
    by("step-back").addEventListener("click", () => { this.play(false); this.go(this.at - 1); });
    by("step-on").addEventListener("click", () => { this.play(false); this.go(this.at + 1); });
    by("replay-close").addEventListener("click", () => show({ drive: null, at: null }));
    by("add").addEventListener("click", () => this.add());
    const scrub = (event) => {
      const box = by("track").getBoundingClientRect();
      this.play(false);
      this.go(Math.floor((event.clientX - box.left) / box.width * this.total()));
    };
    by("track").addEventListener("pointerdown", (event) => { by("track").setPointerCapture(event.pointerId); scrub(event); });
    by("track").addEventListener("pointermove", (event) => { if (event.buttons) scrub(event); });
    by("track").addEventListener("keydown", (event) => {
      const steps = { ArrowLeft: -1, ArrowRight: 1, PageUp: 10, PageDown: -10, Home: -1e9, End: 1e9 };
      if (event.key === " ") this.toggle();
      else if (steps[event.key]) { this.play(false); this.go(this.at + steps[event.key]); } else return;
      event.preventDefault();
    });
  }

  total() { return Math.max(1, this.known ?? this.places.length); }

  // What stands in the address: a dataset or the id of an upload, and the number of a place.
  async set(drive, at) {
    if (drive !== this.drive) await this.open(drive);
    if (drive && at !== undefined && +at !== this.at) { this.wanted = +at; this.play(false); this.go(+at); }
  }

  async open(drive) {
    this.close();
    this.drive = drive || undefined;
    by("replay").hidden = !drive;
    if (!drive) return;
    this.isUpload = !this.page.info.datasets.some((one) => one.name === drive);
    this.note("Looking it up, place by place…");
    const index = this.page.index;
    const address = `/api/replay/${encodeURIComponent(drive)}` + (index ? `?index=${encodeURIComponent(index)}` : "");
    const source = this.source = new EventSource(address);
    const on = (kind, act) => source.addEventListener(kind, (event) => { if (source === this.source) act(JSON.parse(event.data)); });
    on("begin", ({ total, file }) => { this.known = total; this.file = file || null; });
    if (!this.isUpload) this.focus([drive]);
    on("progress", (upload) => this.reading(upload));
    on("place", (place) => this.arrived(place));
    on("end", (upload) => this.ended(upload));
    source.onerror = () => { if (source.readyState === EventSource.CLOSED && source === this.source) this.failed("This drive is not there any more; drop it again."); };
    this.play(shown().at === undefined);
  }

  // Brings the drive into view, unless the building was moved by hand.
  focus(names) {
    const { building } = this.page;
    if (building.moved) return;
    building.focus(names);
  }

  close() {
    if (this.source) this.source.close();
    this.source = null;
    Object.assign(this, { places: [], at: -1, known: null, file: null, seen: 0, wanted: null });
    this.play(false);
    by("add").hidden = true;
    this.page.building.setGuest && this.page.building.guest && this.page.building.setGuest(null);
    this.page.building.mark({ trail: [], arcs: [] });
  }

  receiving(name) {
    by("replay").hidden = false;
    this.note(`Sending ${name}…`);
  }

  failed(message) {
    by("replay").hidden = false;
    this.note(message);
    by("replay-note").setAttribute("role", "alert");
  }

  note(text) {
    by("replay-note").removeAttribute("role");
    by("replay-note").textContent = text;
  }

  reading(upload) {
    const { stage, done, total } = upload.progress;
    const names = { reading: "reading", scans: "matching scans", views: "looking around", maps: "describing maps" };
    this.file = upload.file;
    if (!this.places.length) this.note(`${upload.file}: ${names[stage] || stage}${total ? ` ${percent(done / total)}` : ""}`);
  }

  arrived(place) {
    this.places[place.number] = place;
    if (this.isUpload && performance.now() - (this.seen || 0) > REFRESH) { this.seen = performance.now(); this.guest(); }
    if (this.wanted === place.number) { this.wanted = null; this.go(place.number); }
    by("track").setAttribute("aria-valuemax", this.total() - 1);
    this.track.redraw();
    if (by("speed").value === "1000" && this.playing) this.go(this.places.length - 1);
  }

  ended(upload) {
    this.source.close();
    this.known = upload.total;
    if (upload.error) { this.failed(upload.error); return; }
    if (this.isUpload) {
      this.file = upload.file;
      this.guest();
      by("add").hidden = !this.page.info.server.writable;
      by("add").textContent = "Add to the index";
      by("add").disabled = false;
    }
    this.track.redraw();
    this.tell();
  }

  // The walls of an upload, in a frame of its own.
  async guest() {
    const id = this.drive;
    try {
      const walls = await this.page.uploads.places(id);
      if (id !== this.drive || !walls.maps) return;
      const box = [Math.min(...walls.place_x), Math.min(...walls.place_y), Math.max(...walls.place_x), Math.max(...walls.place_y)];
      const { building } = this.page;
      building.setGuest({ name: `upload:${id}`, label: this.file || "upload", guest: true, box, places: walls, walls: null });
      building.setWalls(`upload:${id}`, walls);
      const found = this.places.filter((place) => place.answer.verdict === "match").map((place) => place.answer.results[0].dataset);
      this.focus([`upload:${id}`, ...new Set(found)]);
    } catch { /* it is fetched anew with the next places */ }
  }

  async add() {
    by("add").disabled = true;
    try {
      await json(`/api/uploads/${this.drive}/index`, { index: this.page.index }, { method: "POST", headers: { "Content-Type": "application/octet-stream" } });
      for (;;) {
        const upload = await json(`/api/uploads/${this.drive}`);
        if (upload.added === "added") break;
        if (upload.added !== "adding") throw new Error(upload.added);
        by("add").textContent = "Adding…";
        await new Promise((resolve) => setTimeout(resolve, 500));
      }
      by("add").textContent = "Added";
      say("added to the index");
      this.page.look();
    } catch (error) { this.failed(error.message); by("add").disabled = false; }
  }

  // What a map of an upload is on the command line.
  fileOf(name) {
    const match = /^upload:[^/]+\/0*(\d+)$/.exec(name);
    return match && this.file ? `${this.file}#${match[1]}` : null;
  }

  // --- Showing it

  // Plays, or pauses at a place, which is then looked at as a query is.
  toggle() {
    this.play(!this.playing);
    if (!this.playing) this.go(this.at);
  }

  play(on) {
    this.playing = on && !!this.drive;
    by("play").textContent = this.playing ? "❚❚" : "▶";
    by("play").setAttribute("aria-label", this.playing ? "Pause" : "Play");
    clearTimeout(this.timer);
    if (!this.playing) return;
    if (this.known && this.at >= this.known - 1) this.at = -1;
    const tick = () => {
      if (!this.playing) return;
      if (this.places[this.at + 1]) this.go(this.at + 1);
      if (this.known && this.at >= this.known - 1) { this.play(false); return; }
      this.timer = setTimeout(tick, 1000 / Math.min(60, +by("speed").value));
    };
    tick();
  }

  go(number) {
    const last = this.places.length - 1;
    const to = Math.max(0, Math.min(last, number));
    if (!this.places[to]) return;
    this.at = to;
    by("track").setAttribute("aria-valuenow", to);
    this.draw();
    this.tell();
    clearTimeout(this.settling);
    if (!this.playing) this.settling = setTimeout(() => show({ at: to, q: this.places[to].query }, true), 250);
  }

  where(place) {
    return place.travel[1] > place.travel[0] ? `after ${place.travel[0].toFixed(1)} m` : `view ${place.number}`;
  }

  tell() {
    const place = this.places[this.at];
    if (!place) return;
    const best = place.answer.results[0];
    const odds = typeof place.answer.probability === "number" ? `, ${sure(place.answer.probability)} sure` : "";
    const text = `${this.where(place)}: ${place.answer.verdict}${odds}${best ? `, ${best.map_id}` : ""}`;
    const counts = { match: 0, ambiguous: 0, none: 0 };
    this.places.forEach((one) => { counts[one.answer.verdict]++; });
    this.note(`${text} · ${thousands(this.places.length)} of ${this.known ? thousands(this.known) : "?"} places: ${counts.match} match, ${counts.ambiguous} ambiguous, ${counts.none} none`);
    by("track").setAttribute("aria-valuetext", text);
  }

  draw() {
    const trail = [], arcs = [];
    const own = this.isUpload ? `upload:${this.drive}` : this.drive;
    this.places.slice(0, this.at + 1).forEach((place, number) => {
      const { verdict, results } = place.answer, best = results[0];
      const from = { dataset: own, pose: place.own_pose };
      trail.push({ ...from, verdict, now: number === this.at });
      if (!best || !best.dataset_pose || verdict !== "match") return;
      const to = { dataset: best.dataset, pose: best.dataset_pose };
      if (this.isUpload) trail.push({ ...to, verdict, now: number === this.at });
      if (!this.isUpload || number === this.at) arcs.push({ from, to, verdict });
    });
    const place = this.places[this.at], best = place.answer.results[0];
    const sure = best && best.dataset_pose && place.answer.verdict === "match";
    this.page.building.mark({
      trail, arcs, query: { dataset: own, pose: place.own_pose }, rival: null, verdict: place.answer.verdict,
      hits: [], pose: sure ? { dataset: best.dataset, pose: best.dataset_pose, covariance: best.covariance } : null,
    });
    const { page } = this;
    page.query.set({ map_id: `${this.file || this.drive}, ${this.where(place)}`, text: place.text }, page.info, null, true);
    page.query.setVerdict(place.answer, (id) => show({ q: id }), true);
    this.track.redraw();
  }

  paint(context) {
    const { width, height } = this.track, total = this.total();
    context.fillStyle = colour.bg;
    context.fillRect(0, 0, width, height);
    const step = width / total;
    this.places.forEach((place, number) => {
      const { verdict } = place.answer, tall = (height - 8) * TALL[verdict];
      context.fillStyle = colour[verdict];
      context.globalAlpha = number <= this.at ? 1 : 0.5;
      context.fillRect(number * step, height - 4 - tall, Math.max(1, step - (step > 4 ? 1 : 0)), tall);
    });
    context.globalAlpha = 1;
    if (this.at >= 0) {
      context.fillStyle = colour.ink;
      context.fillRect((this.at + 0.5) * step - 1, 0, 2, height);
    }
  }
}
