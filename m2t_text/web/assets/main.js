// The page: what the address says is fetched and shown, and what is clicked on changes the address.

import { shown, show, whenShown } from "./address.js";
import { ask, columns, json } from "./api.js";
import { Building } from "./building.js";
import { Compare } from "./compare.js";
import { by, fill, legend, make, say, thousands } from "./elements.js";
import { inverse, compose } from "./geometry.js";
import { Hits } from "./hits.js";
import { QueryPanel } from "./query.js";
import { Replay } from "./replay.js";
import { isToken, nearby } from "./text.js";
import { start as startTheme } from "./theme.js";
import { Uploads } from "./uploads.js";

const POLL = 3000; // ms from one look for a new commit to the next
const OTHER_VISITS = 10; // m of travel: the maps of one visit repeat each other
const LAID = 3; // hits on which the query is laid
const FEW_TOKENS = 12; // a text of more is looked up as a map is; fewer are looked for literally

class Page {
  constructor() {
    this.building = new Building(by("building"), {
      pointed: (number, guest, x, y) => this.tip(number, guest, x, y),
      picked: (number, guest, compare) => this.picked(number, guest, compare),
    });
    this.query = new QueryPanel();
    this.hits = new Hits({
      open: (id) => show({ q: id, at: null }),
      compare: (id) => show({ a: shown().q, b: id }),
    });
    this.compare = new Compare();
    this.replay = new Replay(this);
    this.uploads = new Uploads(this);
    this.listen();
    whenShown((now, before) => this.update(now, before));
  }

  get index() { return shown().index || null; }

  listen() {
    by("ask").addEventListener("submit", (event) => { event.preventDefault(); this.asked(by("query").value.trim()); });
    by("index").addEventListener("change", () => show({ index: by("index").value, q: null, where: null, a: null, b: null, drive: null, at: null, hide: null }));
    for (const [id, name] of [["travel-from", "from"], ["travel-to", "to"]]) {
      by(id).addEventListener("change", () => show({ [name]: by(id).value }));
    }
    by("zoom-in").addEventListener("click", () => this.building.zoom(1.4));
    by("zoom-out").addEventListener("click", () => this.building.zoom(1 / 1.4));
    by("zoom-fit").addEventListener("click", () => { this.building.fit(); this.building.moved = false; });
    document.querySelectorAll("[data-copy]").forEach((button) => button.addEventListener("click", async () => {
      try { await navigator.clipboard.writeText(by(button.dataset.copy).textContent); say("copied"); button.textContent = "Copied"; }
      catch { getSelection().selectAllChildren(by(button.dataset.copy)); }
      setTimeout(() => { button.textContent = "Copy"; }, 1500);
    }));
    addEventListener("click", (event) => { if (!by("datasets").contains(event.target)) by("datasets").open = false; });
    document.addEventListener("keydown", (event) => {
      if (event.key === "/" && !/INPUT|SELECT/.test(document.activeElement.tagName)) { event.preventDefault(); by("query").focus(); }
      if (event.key === "Escape") by("datasets").open = false;
    });
    document.addEventListener("visibilitychange", () => { if (!document.hidden) this.look(); });
  }

  // --- The index

  async start() {
    await this.load();
    this.update(shown(), {});
    setInterval(() => { if (!document.hidden) this.look(); }, POLL);
  }

  // Whether there is a new commit, or no server any more.
  async look() {
    if (this.looking) return;
    this.looking = true;
    try {
      const tag = this.info && this.info.revision ? { "If-None-Match": `"${this.info.revision}"` } : {};
      const response = await ask("/api/info", { index: this.index }, { headers: tag });
      this.found();
      const info = response && await response.json();
      if (info && info.revision !== (this.info || {}).revision) {
        await this.load(info);
        say(`the index has changed: ${thousands(info.maps)} maps`);
      }
    } catch (error) { this.lost(error); } finally { this.looking = false; }
  }

  lost(error) {
    by("banner").hidden = false;
    by("banner").textContent = error.lost
      ? "The server does not answer. Start it again with `m2t-text serve`; this page goes on by itself." : error.message;
  }

  found() { by("banner").hidden = true; }

  async load(info = null) {
    try {
      this.info = info || await json("/api/info", { index: this.index });
      this.found();
    } catch (error) { this.lost(error); return; }
    this.head();
    const places = this.info.maps ? await columns("/api/places", { index: this.index }) : { maps: 0, datasets: [] };
    this.building.moved = false;
    this.building.setPlaces(places);
    this.empty();
    this.narrow(shown());
    this.walls();
  }

  head() {
    const { info } = this, names = info.indexes || [];
    fill(by("index"), names.map((name) => make("option", { value: name }, name)));
    if (this.index) by("index").value = this.index;
    by("index-field").hidden = names.length < 2;
    by("datasets-summary").textContent = `${info.datasets.length} ${info.datasets.length === 1 ? "dataset" : "datasets"}`;
    fill(by("datasets-list"), info.datasets.map((dataset) => this.datasetRow(dataset)));
    const note = info.maps ? `${thousands(info.maps)} maps of ${info.path}, profile ${info.profile}` : info.path;
    by("building-note").textContent = note;
    document.title = `m2t-text: ${info.path}`;
  }

  datasetRow(dataset) {
    const box = make("input", { type: "checkbox", checked: !this.hiddenNames().has(dataset.name), onchange: () => {
      const hidden = this.hiddenNames();
      if (box.checked) hidden.delete(dataset.name); else hidden.add(dataset.name);
      show({ hide: hidden.size ? JSON.stringify([...hidden]) : null });
    } });
    const about = `${thousands(dataset.maps)} maps` + (dataset.travel ? `, ${Math.round(dataset.travel)} m` : "");
    const play = dataset.travel ? make("button", { type: "button", title: "Watch it being recognised", "aria-label": `Replay ${dataset.name}`,
      onclick: () => { by("datasets").open = false; show({ drive: dataset.name, at: null }); } }, "▶ replay") : null;
    return make("div", { class: "row" }, make("label", {}, box, make("span", {}, dataset.name)), make("small", {}, about), play);
  }

  hiddenNames() {
    try { return new Set(JSON.parse(shown().hide || "[]")); } catch { return new Set(); }
  }

  // Walls of one dataset after the other, the nearest to what is looked at first.
  async walls() {
    const wanted = this.walling = {};
    const { info } = this;
    for (const frame of this.building.frames) {
      if (this.walling !== wanted) return;
      if (frame.hidden || (frame.walls && frame.walls.revision === info.revision)) continue;
      try {
        const walls = await columns("/api/walls", { dataset: frame.name, index: this.index });
        this.building.setWalls(frame.name, walls);
        if (frame.walls) frame.walls.revision = info.revision;
      } catch (error) { if (error.lost) { this.lost(error); return; } }
    }
  }

  empty() {
    const { info } = this, box = by("empty");
    box.hidden = info.maps > 0;
    if (!info.maps) {
      fill(box, make("strong", {}, info.error ? "There is no index here yet" : "This index is empty"),
        make("span", {}, "Put a drive into it, and it shows up here by itself:"),
        make("code", {}, `m2t-text index robot.log --index ${info.path}`),
        make("span", {}, info.server.writable ? "Or drop a log here, and add it." : "A log that is dropped here can be looked at, not added: the server was started without --write."));
    }
    fill(by("legend"), info.maps ? legend([["place", "a map begins"], ["find", "has the tokens"], ["query", "query"], ["hit", "hit"], ["rival", "rival"]]) : []);
    if (!info.maps) this.query.clear("");
  }

  // --- What is asked

  asked(text) {
    const [, name, narrower] = /^(.*?)(?:\s*--where\s+(.*))?$/s.exec(text);
    const words = name.trim().split(/\s+/).filter(Boolean);
    const literal = words.length && (words.some((word) => /[:[\]()]/.test(word) || /^(AND|OR|NOT)$/.test(word)) && !/^upload:/.test(name)
      || words.every(isToken) && words.length <= FEW_TOKENS);
    if (!name && !narrower) show({ q: null, where: null });
    else if (literal) show({ q: null, where: narrower ? `(${name.trim()}) AND (${narrower})` : name.trim() });
    else show({ q: name.trim() || null, where: narrower || null, at: null });
    if (JSON.stringify(shown()) === this.last) this.update(shown(), {});
  }

  picked(number, guest, compare) {
    const id = guest >= 0 ? `${this.building.guest.name}/${String(this.building.guest.places.first_scan[guest]).padStart(6, "0")}`
      : this.building.placeId(number);
    this.building.cursor = number;
    if (compare && shown().q) show({ a: shown().q, b: id });
    else show({ q: id });
  }

  tip(number, guest, x, y) {
    const tip = by("tip"), { building } = this;
    tip.hidden = number < 0 && guest < 0;
    if (tip.hidden) return;
    const travel = guest >= 0 ? building.guest.places.travel[guest] : building.places.travel[number];
    tip.textContent = `${guest >= 0 ? building.guest.label : building.placeId(number)}, after ${travel.toFixed(1)} m`;
    if (document.activeElement === by("building")) say(tip.textContent);
    const width = by("building").clientWidth;
    tip.style.left = `${Math.min(x + 14, width - tip.offsetWidth - 6)}px`;
    tip.style.top = `${Math.max(4, y - 34)}px`;
  }

  async update(now, before) {
    this.last = JSON.stringify(now);
    if (!this.info) return;
    if (now.index !== before.index && before.index !== undefined) await this.load();
    if (now.hide !== before.hide) {
      this.building.hide(this.hiddenNames());
      this.walls();
    }
    by("travel-from").value = now.from || "";
    by("travel-to").value = now.to || "";
    by("query").value = [now.q, now.where && (now.q ? `--where ${now.where}` : now.where)].filter(Boolean).join(" ");
    const same = ["q", "where", "from", "to", "index"].every((name) => now[name] === before[name]);
    const jobs = [];
    if (!same || !Object.keys(before).length) jobs.push(this.narrow(now), this.search(now));
    jobs.push(this.compare.set(now.a, now.b, this.index), this.replay.set(now.drive, now.at));
    await Promise.all(jobs);
  }

  // Which places are pale: outside the range of travel, or not found by the filter.
  async narrow(now) {
    const from = parseFloat(now.from) || 0, to = parseFloat(now.to) || Infinity;
    if (!now.where || !this.info.maps) { this.building.filter(from, to, null); return; }
    if (!now.q) this.query.clear(`Looking for ${now.where}…`);
    try {
      const told = await json("/api/matching", { where: nearby(now.where), index: this.index });
      this.building.filter(from, to, told.places);
      const note = `${thousands(told.total)} of ${thousands(this.info.maps)} maps have ${now.where}`;
      say(note);
      if (!now.q) await this.listMatching(now, note);
    } catch (error) {
      this.building.filter(from, to, null);
      if (error.lost) this.lost(error); else this.query.clear(error.message);
    }
  }

  // Some of the maps that a filter finds, to look at.
  async listMatching(now, note) {
    const { maps } = await json("/api/maps", { where: nearby(now.where), limit: 200, index: this.index });
    const some = maps.filter((map, k) => k % Math.max(1, Math.floor(maps.length / 6)) === 0).slice(0, 6);
    this.query.clear(`${note}.`, some.map((map) => [map.map_id, `after ${map.travel[0].toFixed(1)} m`, () => show({ q: map.map_id })]));
  }

  where(now) {
    const range = now.from || now.to ? `travel:[${now.from || 0} TO ${now.to || ""}]` : "";
    return [now.where && (range ? `(${nearby(now.where)})` : nearby(now.where)), range].filter(Boolean).join(" AND ") || null;
  }

  async search(now) {
    if (this.asking) this.asking.abort();
    if (!now.q) {
      this.answer = null;
      this.hits.clear();
      this.building.mark({ query: null, hits: [], rival: null, pose: null });
      by("same").hidden = true;
      if (!now.where && this.info.maps) this.idle();
      return;
    }
    const asking = this.asking = new AbortController();
    const driven = !isToken(now.q.split(" ")[0]);
    const parameters = { query: now.q, exclude_travel: driven && this.travels(now.q) ? OTHER_VISITS : null, where: this.where(now), compare: LAID, index: this.index };
    const slow = setTimeout(() => this.query.busy("Looking it up… The first search on a machine compiles code, once."), 1500);
    try {
      const answer = await json("/api/search", parameters, { signal: asking.signal });
      if (asking !== this.asking) return;
      this.found();
      this.showAnswer(answer, now, parameters);
    } catch (error) {
      if (error.name === "AbortError") return;
      if (error.lost) this.lost(error);
      this.hits.clear();
      this.building.mark({ query: null, hits: [], rival: null, pose: null });
      this.query.clear(error.message);
      by("same").hidden = true;
    } finally { clearTimeout(slow); }
  }

  // What could be looked up, where nothing is.
  idle() {
    const { building, info } = this, { places } = building;
    const some = building.placeId(Math.floor(places.maps * 0.4)), driven = info.datasets.find((one) => one.travel > 0);
    const tries = [[some, "a place: its text, and the maps that show it, too", () => show({ q: some })]];
    if (driven) {
      tries.push([`${driven.name}@${(driven.travel * 0.4).toFixed(0)}`, "where a drive was after so many metres", () => show({ q: `${driven.name}@${(driven.travel * 0.4).toFixed(0)}` })]);
      tries.push(["x12_y-3_a16", "a token: all places that have this word near this spot", () => show({ where: "x12_y-3_a16" })]);
      tries.push([`▶ ${driven.name}`, "a drive, recognised as it went", () => show({ drive: driven.name })]);
    }
    this.query.clear("Click on a place of the building, or try", tries);
  }

  travels(name) {
    if (name.startsWith("upload:")) return false;
    const dataset = this.info.datasets.find((one) => name.startsWith(`${one.name}/`) || name.startsWith(`${one.name}@`) || name.startsWith(`${one.name}#`));
    return !dataset || dataset.travel > 0;
  }

  showAnswer(answer, now, parameters) {
    this.answer = answer;
    const { query_map: map } = answer;
    this.query.set(map, this.info, now.where);
    this.query.setVerdict(answer, (id) => show({ q: id }));
    if (answer.comparisons.length) this.query.setStatus(answer.comparisons[0].query_keypoints);
    this.hits.set(answer, map, this.info.parameters.mapping.cell);
    this.markAnswer(answer, map, now.q);
    this.same(parameters, map);
    requestAnimationFrame(() => requestAnimationFrame(() => performance.mark("hits drawn")));
    say(`${answer.verdict}: ${answer.results.length ? answer.results[0].map_id : "no hit"}`);
  }

  // The query, its hits and its rival on the building.
  markAnswer(answer, map, name) {
    const { building } = this, cell = this.info.parameters.mapping.cell;
    const upload = name.startsWith("upload:") ? name.split("/")[0] : null;
    const best = answer.results[0];
    const hits = answer.results.slice(0, LAID).map((one) => {
      const laid = (answer.comparisons || []).find((comparison) => comparison.map.map_id === one.map_id);
      return { rank: one.rank, dataset: one.dataset, pose: laid ? laid.map.dataset_pose : this.placePose(one) };
    });
    const rival = answer.reason && answer.reason.rival && this.rivalPose(answer.reason.rival);
    const sure = answer.verdict === "match" && best && best.dataset_pose;
    building.mark({
      query: map.dataset_pose ? { dataset: upload || map.dataset, pose: map.dataset_pose } : null,
      hits, rival, verdict: answer.verdict,
      pose: sure ? { dataset: best.dataset, pose: best.dataset_pose, covariance: best.covariance } : null, cell,
    });
    const at = building.locate(upload || map.dataset, map.dataset_pose);
    if (!building.moved && building.frames.length > 1) {
      building.focus([upload || map.dataset, ...(answer.verdict === "none" || !best ? [] : [best.dataset])]);
      building.moved = true;
    } else if (at) building.reveal(at);
    if (map.map_id && !upload) building.cursor = building.placeNumber(map.dataset, map.first_scan);
  }

  placePose(result) {
    const number = this.building.placeNumber(result.dataset, result.first_scan);
    if (number < 0) return null;
    const { x, y, theta } = this.building.places;
    return [x[number], y[number], theta[number]];
  }

  rivalPose(id) {
    const cut = id.lastIndexOf("/"), dataset = id.slice(0, cut);
    const pose = this.placePose({ dataset, first_scan: +id.slice(cut + 1) });
    return pose && { dataset, pose };
  }

  same(parameters, map) {
    by("same").hidden = false;
    const quoted = (word) => (/^[\w@#/.:=-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`);
    const words = ["m2t-text", "search", map.map_id && !parameters.query.startsWith("upload:") ? map.map_id : this.replay.fileOf(parameters.query) || parameters.query, "--index", this.info.path];
    if (parameters.exclude_travel) words.push("--exclude-travel", String(parameters.exclude_travel));
    if (parameters.where) words.push("--where", parameters.where);
    by("same-command").textContent = [...words.map(quoted), "--json"].join(" ");
    const { compare, ...plain } = parameters;
    const query = new URLSearchParams(Object.entries(plain).filter(([, value]) => value !== null));
    by("same-address").textContent = `${location.origin}/api/search?${query}`;
  }
}

startTheme(by("theme"));
const page = new Page();
window.m2t = page; // for the curious, and for tests
page.start();
export { inverse, compose };
