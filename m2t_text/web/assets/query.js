// The query's panel: its text on its walls, token by token, and the verdict.

import { by, fill, link, make, sure } from "./elements.js";
import { degrees } from "./geometry.js";
import { MapView } from "./mapview.js";
import { foundBy, parse, spoken } from "./text.js";

const SIGNS = { match: "✓", ambiguous: "≈", none: "∅" };
const SAYS = {
  match: "This is the place.",
  ambiguous: "Something fits, but not well enough to be sure.",
  none: "Nothing in the index fits.",
};
const NOTE = "Point at a keypoint or a token: both are the same.";

export class QueryPanel {
  constructor() {
    this.spans = [];
    this.view = new MapView(by("query-canvas"), (number) => this.light(number));
    by("tokens").addEventListener("pointerover", (event) => {
      const index = event.target.dataset && event.target.dataset.k;
      if (index !== undefined) this.light(+index, false);
    });
    by("tokens").addEventListener("pointerleave", () => this.light(null));
    by("tokens").addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!step || !this.text) return;
      event.preventDefault();
      const count = this.text.keypoints.length;
      this.light(((this.lit ?? (step > 0 ? -1 : 0)) + step + count) % count);
    });
  }

  // A map as `/api/maps/ID` gives it; `where` may hold typed tokens, which are shown where they are found.
  set(map, info, where, moving = false) {
    document.querySelector(".query").classList.remove("idle");
    this.info = info;
    this.text = parse(map.text);
    this.map = map;
    const { mapping, description, matching } = info.parameters;
    this.view.radii = description.radii;
    this.view.found = where ? foundBy(this.text.keypoints, where, matching.window) : new Set();
    this.status = null;
    this.draw(mapping.cell);
    if (moving) { this.spans = []; by("query-note").textContent = map.map_id; fill(by("tokens")); return; }
    const travel = map.travel ? `, ${map.travel[0].toFixed(1)}–${map.travel[1].toFixed(1)} m` : "";
    const free = this.text.squares.length ? `, ${this.text.squares.length} free squares` : "";
    by("query-note").textContent = `${map.map_id || "text"}${travel}: ${map.keypoints} keypoints, ${map.words} words${free}`;
    this.tokens();
  }

  // What became of each keypoint on the hit that is looked at: a string of digits, or null.
  setStatus(status) {
    this.status = status;
    this.draw(this.info.parameters.mapping.cell);
    this.spans.forEach((span, k) => {
      span.classList.toggle("shared", !!status && status[k] === "2");
      span.classList.toggle("conflict", !!status && status[k] === "3");
    });
  }

  draw(cell) {
    this.view.set([{ text: this.text, pose: [0, 0, 0], colour: "query", status: null }], cell);
  }

  tokens() {
    const { text } = this;
    this.spans = [];
    const numbers = new Map(text.keypoints.map((keypoint, k) => [keypoint.index, k]));
    const spans = text.tokens.flatMap((token, index) => {
      const k = numbers.get(index);
      const span = make("span", k === undefined ? { class: "free" } : { "data-k": k }, token);
      if (k !== undefined) {
        this.spans[k] = span;
        if (this.view.found.has(text.keypoints[k])) span.classList.add("found");
      }
      return [span, " "];
    });
    fill(by("tokens"), spans);
    const first = this.spans.find((span) => span.classList.contains("found"));
    by("tokens").scrollTop = first ? first.offsetTop - by("tokens").offsetTop - 30 : 0;
  }

  light(number, scroll = true) {
    if (number === this.lit) return;
    if (this.spans[this.lit]) this.spans[this.lit].classList.remove("lit");
    this.lit = number;
    this.view.light(number);
    const span = this.spans[number];
    const { mapping, description } = this.info ? this.info.parameters : {};
    by("token-note").textContent = span
      ? `${span.textContent}: ${spoken(this.text.keypoints[number], mapping.cell, description.radii)}` : NOTE;
    if (!span) return;
    span.classList.add("lit");
    if (scroll) by("tokens").scrollTop = span.offsetTop - by("tokens").offsetTop - 40;
  }

  // Nothing is looked up: what could be. `tries` are [text, explanation, what a click does].
  clear(note, tries = []) {
    document.querySelector(".query").classList.add("idle");
    this.text = null;
    this.lit = null;
    this.view.set([], 0.1);
    this.view.layers = [];
    fill(by("tokens"));
    const items = tries.map(([text, why, act]) => make("li", {}, link(text, act), make("small", {}, why)));
    fill(by("verdict"), items.length ? make("ul", { class: "try" }, items) : null);
    by("query-note").textContent = note;
    by("token-note").textContent = NOTE;
  }

  busy(note) { fill(by("verdict"), make("p", {}, note)); }

  // An answer of `/api/search`; `open` is called with the id of a map that is clicked on.
  setVerdict(answer, open, moving = false) {
    const { verdict, probability, reason } = answer, best = answer.results[0];
    const badge = make("span", { class: `badge ${verdict}` }, `${SIGNS[verdict]} ${verdict}`);
    const odds = typeof probability === "number"
      ? make("span", { class: "odds", title: "that the pose of the first hit is right" }, `${sure(probability)} sure`) : null;
    const lines = [make("p", {}, (reason && reason.text) || SAYS[verdict])];
    if (reason && reason.rival) lines.push(make("p", {}, "Rival: ", link(reason.rival, () => open(reason.rival))));
    if (best && best.dataset_pose && verdict !== "none") {
      const [x, y, theta] = best.dataset_pose;
      const give = best.covariance
        ? ` ± ${Math.sqrt(best.covariance[0][0]).toFixed(2)}, ${Math.sqrt(best.covariance[1][1]).toFixed(2)} m` : "";
      lines.push(make("p", { class: "where" },
        `pose in ${best.dataset}: ${x.toFixed(2)} ${y.toFixed(2)} m, ${degrees(theta)}°${give}`));
    }
    const { search, verify } = answer.seconds;
    if (!moving) lines.push(make("p", { class: "note" },
      `among ${answer.index.maps.toLocaleString("en")} maps: searched in ${Math.round(search * 1000)} ms, verified in ${Math.round(verify * 1000)} ms`));
    fill(by("verdict"), badge, odds, lines);
  }
}
