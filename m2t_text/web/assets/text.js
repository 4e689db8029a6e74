// The text of a map: tokens x12_y-3_a517 (a keypoint) and x8_y-4_f4 (a free square), and what they stand for.

const TOKEN = /^x(-?\d+)_y(-?\d+)_([af])(\d+)$/;

// Arrays of a text: keypoints x, y, word and squares x, y, side, in cells; `tokens` as they stand in the text.
export function parse(text) {
  const tokens = text.split(/\s+/).filter(Boolean);
  const keypoints = [], squares = [];
  tokens.forEach((token, index) => {
    const match = TOKEN.exec(token);
    if (!match) return;
    const one = { x: +match[1], y: +match[2], value: +match[4], index };
    (match[3] === "a" ? keypoints : squares).push(one);
  });
  return { tokens, keypoints, squares };
}

export const isToken = (word) => TOKEN.test(word.replace(/~\d*$/, ""));

// A query in which tokens stand for their neighbours within the window, too, unless it says how far (TOKEN~0).
export const nearby = (where) => where && where.replace(/\b(x-?\d+_y-?\d+_a\d+)(?![\d~])/g, "$1~");

// What a keypoint says, in words; `cell` and `radii` are the index's.
export function spoken(keypoint, cell, radii) {
  const along = (keypoint.x + 0.5) * cell, across = (keypoint.y + 0.5) * cell;
  const place = `${Math.abs(along).toFixed(1)} m ${along < 0 ? "behind" : "ahead"}, ` +
    `${Math.abs(across).toFixed(1)} m to the ${across < 0 ? "right" : "left"}`;
  const rings = radii.map((radius, bit) => (keypoint.value >> bit) & 1 ? radius : 0).filter(Boolean);
  const named = rings.map((radius) => `${radius.toFixed(2).replace(/0$/, "")} m`).join(", ");
  return `${place} of the viewpoint. Word ${keypoint.value}: ` +
    (rings.length ? `the rings up to ${named} hold more than their share of points.` : "nothing is around it.");
}

// Keypoints that a typed token finds: the same word, and a position within the window.
export function foundBy(keypoints, typed, window) {
  const sought = [...typed.matchAll(/(x-?\d+_y-?\d+_a\d+)(?:~(\d+))?/g)].map(([, token, reach]) =>
    ({ ...parse(token).keypoints[0], reach: reach === undefined ? window : +reach }));
  return new Set(keypoints.filter((k) => sought.some((s) =>
    s.value === k.value && Math.abs(s.x - k.x) <= s.reach && Math.abs(s.y - k.y) <= s.reach)));
}
