// Questions to the server. A failure is an Error with the server's one line; `lost` says that nobody answered.

export async function ask(path, parameters = {}, options = {}) {
  const query = new URLSearchParams();
  for (const [name, value] of Object.entries(parameters)) {
    if (value !== null && value !== undefined && value !== "") query.set(name, value);
  }
  const address = query.size ? `${path}?${query}` : path;
  let response;
  try {
    response = await fetch(address, options);
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw Object.assign(new Error("the server does not answer"), { lost: true });
  }
  if (response.status === 304) return null;
  if (!response.ok) {
    const told = await response.json().catch(() => ({}));
    throw Object.assign(new Error(told.error || `the server said ${response.status}`), { status: response.status });
  }
  return response;
}

export async function json(path, parameters, options) {
  const response = await ask(path, parameters, options);
  return response && response.status !== 204 ? response.json() : null;
}

const TYPES = { f4: Float32Array, u4: Uint32Array, u2: Uint16Array, u1: Uint8Array };

// A header and columns of numbers; see packing.py.
export async function columns(path, parameters) {
  const buffer = await (await ask(path, parameters)).arrayBuffer();
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  let at = 4 + length;
  for (const column of header.columns) {
    const array = new TYPES[column.type](buffer, at, column.length);
    header[column.name] = array;
    at += array.byteLength + (8 - array.byteLength % 8) % 8;
  }
  return header;
}
