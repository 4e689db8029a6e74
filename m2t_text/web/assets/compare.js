// Any two maps, one laid on the other.

import { json } from "./api.js";
import { show } from "./address.js";
import { by, fill, make, say } from "./elements.js";
import { degrees } from "./geometry.js";
import { scoreParts } from "./hits.js";
import { MapView } from "./mapview.js";
import { parse } from "./text.js";

export class Compare {
  constructor() {
    by("compare-close").addEventListener("click", () => show({ a: null, b: null }));
    by("compare-form").addEventListener("submit", (event) => {
      event.preventDefault();
      show({ a: by("compare-a").value.trim(), b: by("compare-b").value.trim() });
    });
  }

  async set(a, b, index) {
    const wanted = by("compare").hidden || this.a !== a || this.b !== b;
    [this.a, this.b] = [a, b];
    by("compare").hidden = !(a || b);
    if (!a && !b) return;
    by("compare-a").value = a || "";
    by("compare-b").value = b || "";
    if (!a || !b) { by("compare-note").textContent = "Name two maps by their ids."; return; }
    try {
      const told = await json("/api/compare", { a, b, index });
      if (this.a !== a || this.b !== b) return;
      this.show(told);
      if (wanted) by("compare").scrollIntoView({ block: "nearest" });
    } catch (error) {
      by("compare-note").textContent = error.message;
      fill(by("compare-tokens"));
      fill(by("compare-parts"));
    }
  }

  show(told) {
    const query = parse(told.query.text), found = parse(told.map.text);
    this.view ||= new MapView(by("compare-canvas"));
    this.view.set([
      { text: found, pose: [0, 0, 0], colour: "hit", status: told.found_keypoints },
      { text: query, pose: told.laid, colour: "query", status: told.query_keypoints },
    ], told.cell);
    const [x, y, theta] = told.laid;
    const note = `${told.shared} of ${query.keypoints.length} keypoints have the same word where they lie; ` +
      `the viewpoint lies at ${x.toFixed(2)} ${y.toFixed(2)} m, ${degrees(theta)}°`;
    by("compare-note").textContent = note;
    say(note);
    fill(by("compare-parts"), scoreParts(null, told));
    const spans = query.keypoints.map((keypoint, k) => {
      const kind = { 2: "shared", 3: "conflict" }[told.query_keypoints[k]];
      return kind ? [make("span", { class: kind }, query.tokens[keypoint.index]), " "] : [];
    });
    fill(by("compare-tokens"), spans.flat());
  }
}
