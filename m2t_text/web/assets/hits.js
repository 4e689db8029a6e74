// The best hits, each with the query laid on it, and the table of all.

import { by, fill, legend, link, make, parts, percent, thousands } from "./elements.js";
import { degrees } from "./geometry.js";
import { MapView } from "./mapview.js";
import { parse } from "./text.js";

export class Hits {
  // `open` is called with a map's id, `compare` with it and `look` with a hit's number when it is pointed at.
  constructor({ open, compare }) {
    this.open = open;
    this.compare = compare;
    this.cards = [];
    fill(by("hit-legend"), legend([["shared", "the same word at the same spot"], ["query", "query"], ["hit", "hit"], ["conflict", "where the other map was seen to be free"]]));
  }

  clear() {
    by("hit-legend").hidden = true;
    fill(by("hits"));
    by("all-hits").hidden = true;
    this.cards = [];
  }

  set(answer, query, cell) {
    const text = parse(query.text);
    const laid = answer.comparisons || [];
    by("hit-legend").hidden = !laid.length;
    while (this.cards.length < laid.length) this.cards.push(this.card());
    this.cards.length = laid.length;
    fill(by("hits"), this.cards.map((card) => card.element));
    laid.forEach((comparison, k) => this.show(this.cards[k], answer.results[k], comparison, text, cell));
    this.table(answer);
  }

  card() {
    const canvas = make("canvas", { role: "img" }), card = { canvas };
    card.rank = make("span", { class: "rank" });
    card.title = make("h3", {});
    card.note = make("p", { class: "note" });
    card.parts = make("div", { class: "parts" });
    card.actions = make("div", { class: "actions" });
    card.element = make("article", { class: "card hit" },
      make("header", {}, card.rank, make("div", {}, card.title, card.note)),
      make("div", { class: "stage" }, canvas), card.parts, card.actions);
    return card;
  }

  show(card, result, comparison, text, cell) {
    card.view ||= new MapView(card.canvas);
    card.rank.textContent = result.rank;
    card.title.textContent = result.map_id;
    const turn = degrees(comparison.laid[2]);
    const [from, to] = result.travel, travel = to > from ? `travel ${from.toFixed(1)}–${to.toFixed(1)} m` : "";
    card.note.textContent = [travel, turn ? `turned by ${turn}°` : ""].filter(Boolean).join(", ");
    card.canvas.setAttribute("aria-label", `The query laid on ${result.map_id}: ${comparison.shared} keypoints with the same word`);
    fill(card.parts, scoreParts(result, comparison));
    fill(card.actions,
      make("button", { type: "button", onclick: () => this.open(result.map_id) }, "Look it up"),
      make("button", { type: "button", onclick: () => this.compare(result.map_id) }, "Compare"));
    card.view.set([
      { text: parse(comparison.map.text), pose: [0, 0, 0], colour: "hit", status: comparison.found_keypoints },
      { text, pose: comparison.laid, colour: "query", status: comparison.query_keypoints },
    ], cell);
  }

  table(answer) {
    by("all-hits").hidden = answer.results.length < 2;
    by("all-hits").querySelector("summary").textContent = `All ${thousands(answer.results.length)} hits`;
    const heads = ["#", "map", "score", "matched", "inliers", "conflicts", "travel (m)"];
    const rows = answer.results.map((one) => make("tr", {}, [
      one.rank, link(one.map_id, () => this.open(one.map_id)), one.score.toPrecision(4), one.matched,
      one.inlier_ratio === null ? "" : percent(one.inlier_ratio),
      typeof one.conflict_ratio === "number" ? `${(100 * one.conflict_ratio).toFixed(1)} %` : "",
      `${one.travel[0].toFixed(1)}–${one.travel[1].toFixed(1)}`,
    ].map((cell) => make("td", {}, cell instanceof Node ? cell : String(cell)))));
    fill(by("hit-table"), make("thead", {}, make("tr", {}, heads.map((head) => make("th", { scope: "col" }, head)))),
      make("tbody", {}, rows));
  }
}

// Why a hit stands where it does.
export function scoreParts(result, comparison) {
  const conflicts = comparison.conflict_ratio ?? (result && result.conflict_ratio);
  const same = comparison.shared / Math.max(1, comparison.query_keypoints.length);
  return parts([
    ["score of the text", result ? Math.min(1, result.score) : null, result ? result.score.toPrecision(3) : ""],
    ["same word here", same, percent(same)],
    ["fits within 0.15 m", comparison.inlier_ratio, percent(comparison.inlier_ratio)],
    ["held in all directions", comparison.grip * 2, percent(comparison.grip * 2)],
    ["where the other is free", typeof conflicts === "number" ? conflicts * 5 : null,
      typeof conflicts === "number" ? `${(100 * conflicts).toFixed(1)} %` : "", true],
  ]);
}
