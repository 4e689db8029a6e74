// What stands out in the building: the query, its hits, the rival, loops of a drive, covariances, names.

import { arrow } from "./canvas.js";
import { ellipse } from "./geometry.js";
import { colour } from "./theme.js";

// Draws `building.marks`: {query, hits, rival, pose, trail, arcs}; see `main.js` and `replay.js`.
export function drawMarks(building, context) {
  const { marks } = building;
  names(building, context);
  if (!(marks.hits || []).length) for (const arc of marks.arcs || []) drawArc(building, context, arc);
  for (const place of marks.trail || []) drawPlace(building, context, place);
  const query = marks.query && building.locate(marks.query.dataset, marks.query.pose);
  links(building, context, query);
  if (marks.rival) numbered(building, context, building.locate(marks.rival.dataset, marks.rival.pose), "?", colour.rival);
  (marks.hits || []).slice().reverse().forEach((hit) => {
    numbered(building, context, building.locate(hit.dataset, hit.pose), String(hit.rank), colour.hit);
  });
  if (marks.pose) drawPose(building, context, marks.pose);
  if (query) pointer(building, context, query, colour.query, 13);
  for (const number of [building.over, building.cursor]) if (number >= 0) ring(building, context, number);
}

function names(building, context) {
  context.font = "600 12px system-ui, sans-serif";
  context.textAlign = "left";
  context.textBaseline = "bottom";
  context.lineJoin = "round";
  for (const frame of building.all()) {
    if (frame.hidden || frame.x === undefined) continue;
    const [x, y] = building.toScreen(frame.x + frame.box[0] + 2, frame.y + frame.box[3] - 1);
    const room = (frame.box[2] - frame.box[0]) * building.view.scale;
    if (room < 40) continue;
    let shown = frame.label || frame.name;
    while (shown.length > 4 && context.measureText(shown).width > room) shown = `${shown.slice(0, -2)}…`.replace("……", "…");
    context.strokeStyle = colour.bg;
    context.lineWidth = 4;
    context.strokeText(shown, x, y);
    context.fillStyle = frame.guest ? colour["query"] : colour.soft;
    context.fillText(shown, x, y);
  }
}

function links(building, context, query) {
  if (!query) return;
  const best = (building.marks.hits || [])[0];
  const hit = best && building.locate(best.dataset, best.pose);
  if (!hit) return;
  const [a, b] = building.toScreen(...query), [c, d] = building.toScreen(...hit);
  if (Math.hypot(a - c, b - d) < 30) return;
  context.beginPath();
  context.moveTo(a, b);
  context.quadraticCurveTo((a + c) / 2 + (d - b) * 0.12, (b + d) / 2 - (c - a) * 0.12, c, d);
  context.strokeStyle = colour[building.marks.verdict] || colour.soft;
  context.lineWidth = 2;
  context.setLineDash(building.marks.verdict === "match" ? [] : [5, 5]);
  context.stroke();
  context.setLineDash([]);
}

function numbered(building, context, place, label, fill) {
  if (!place) return;
  const [x, y] = building.toScreen(...place);
  context.beginPath();
  context.arc(x, y, 9, 0, 2 * Math.PI);
  context.fillStyle = fill;
  context.fill();
  context.lineWidth = 2;
  context.strokeStyle = colour.panel;
  context.stroke();
  context.fillStyle = colour.panel;
  context.font = "700 11px system-ui, sans-serif";
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(label, x, y + 0.5);
}

function pointer(building, context, place, fill, size) {
  const [x, y] = building.toScreen(...place);
  arrow(context, x, y, place[2], size, fill, colour.panel);
}

// Where the robot is said to be, in the frame of its best hit, and the ellipse that holds it 95 times in 100.
function drawPose(building, context, { dataset, pose, covariance }) {
  const place = building.locate(dataset, pose);
  if (!place) return;
  const [x, y] = building.toScreen(...place);
  if (covariance) {
    const { major, minor, angle } = ellipse(covariance);
    const scale = building.view.scale;
    context.beginPath();
    context.ellipse(x, y, Math.max(2, major * scale), Math.max(2, minor * scale), -angle, 0, 2 * Math.PI);
    context.globalAlpha = 0.25;
    context.fillStyle = colour.query;
    context.fill();
    context.globalAlpha = 1;
    context.strokeStyle = colour.query;
    context.lineWidth = 1.5;
    context.stroke();
  }
  pointer(building, context, place, colour.query, 13);
}

function ring(building, context, number) {
  const [x, y] = building.toScreen(building.wx[number], building.wy[number]);
  context.beginPath();
  context.arc(x, y, 8, 0, 2 * Math.PI);
  context.strokeStyle = colour.ink;
  context.lineWidth = 2;
  context.stroke();
}

// A place of a drive that was looked up: filled where it is a match, a ring where not.
function drawPlace(building, context, { dataset, pose, verdict, now }) {
  const place = building.locate(dataset, pose);
  if (!place) return;
  const [x, y] = building.toScreen(...place);
  context.beginPath();
  context.arc(x, y, now ? 6 : 3.4, 0, 2 * Math.PI);
  context.fillStyle = context.strokeStyle = colour[verdict];
  context.lineWidth = 1.5;
  if (verdict === "match") context.fill(); else context.stroke();
}

// A loop: from a place of a drive to where it was before.
function drawArc(building, context, { from, to, verdict }) {
  const [a, b] = [building.locate(from.dataset, from.pose), building.locate(to.dataset, to.pose)];
  if (!a || !b) return;
  const [x0, y0] = building.toScreen(...a), [x1, y1] = building.toScreen(...b);
  const lift = Math.min(60, 14 + Math.hypot(x1 - x0, y1 - y0) * 0.18);
  context.beginPath();
  context.moveTo(x0, y0);
  context.quadraticCurveTo((x0 + x1) / 2, (y0 + y1) / 2 - lift, x1, y1);
  context.strokeStyle = colour[verdict];
  context.globalAlpha = 0.75;
  context.lineWidth = 1.4;
  context.stroke();
  context.globalAlpha = 1;
}
