// Where the frames of datasets lie beside each other, and walls as they look from afar.

const TRIES = 60; // lengths of a row
const MARGIN = 9, GAP = 4; // metres about a dataset's places, which its walls take; and between two datasets

// Sets x and y of frames, so that their boxes lie in rows, the largest first, in about this shape.
export function layOut(frames, aspect) {
  const boxes = frames.map((frame) => {
    frame.plain ||= frame.box;
    const [x0, y0, x1, y1] = frame.plain;
    frame.box = [x0 - MARGIN, y0 - MARGIN, x1 + MARGIN, y1 + MARGIN];
    return { frame, width: x1 - x0 + 2 * MARGIN + GAP, height: y1 - y0 + 2 * MARGIN + 2 * GAP };
  });
  boxes.sort((a, b) => b.height - a.height);
  let best = null;
  const widest = Math.max(0, ...boxes.map((box) => box.width)), all = boxes.reduce((sum, box) => sum + box.width, 0);
  for (let k = 0; k <= TRIES; k++) {
    const laid = shelves(boxes, widest + (all - widest) * (k / TRIES) ** 2);
    const shape = Math.min(aspect / laid.width, 1 / laid.height);
    if (!best || shape > best.shape) best = { ...laid, shape };
  }
  for (const { frame, x, y } of best ? best.places : []) {
    frame.x = x - frame.box[0];
    frame.y = -y - frame.box[3];
  }
}

// Boxes in rows no longer than a limit; y goes down.
function shelves(boxes, limit) {
  const places = [];
  let x = 0, y = 0, deep = 0, width = 0;
  for (const box of boxes) {
    if (x > 0 && x + box.width > limit + 0.001) { x = 0; y += deep; deep = 0; }
    places.push({ frame: box.frame, x, y });
    x += box.width;
    deep = Math.max(deep, box.height);
    width = Math.max(width, x);
  }
  return { places, width, height: y + deep };
}

// The same walls in cells of twice the size; as many maps have seen one as have seen the most seen part of it.
export function coarser(walls) {
  const cells = new Map();
  for (let k = 0; k < walls.x.length; k++) {
    const key = (walls.x[k] >> 1) * 65536 + (walls.y[k] >> 1);
    if (!(cells.get(key) >= walls.seen[k])) cells.set(key, walls.seen[k]);
  }
  const x = new Uint16Array(cells.size), y = new Uint16Array(cells.size), seen = new Uint8Array(cells.size);
  let k = 0;
  for (const [key, count] of cells) {
    x[k] = Math.floor(key / 65536);
    y[k] = key % 65536;
    seen[k++] = count;
  }
  return { x, y, seen, cell: walls.cell * 2, origin: walls.origin };
}
