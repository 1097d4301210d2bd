// Parts of the binary glTF of a model: its source, or one of its levels.

const JSON_CHUNK = 0x4e4f534a;

// The bytes of a base64 block of the page.
export function bytesOf(id) {
  const text = atob(document.getElementById(id).textContent.trim());
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

// The JSON of a file and what follows it.
export function split(bytes) {
  const view = new DataView(bytes.buffer);
  const length = view.getUint32(12, true);
  const json = JSON.parse(new TextDecoder().decode(bytes.subarray(20, 20 + length)));
  return { json, rest: bytes.subarray(20 + length) };
}

// Names of the levels, in the order of the slider.
export function levelsOf(json) {
  return json.extras?.levels ?? [];
}

// A file with one part alone: 0 is the source, 1 the first level. A node may belong to several parts.
export function part({ json, rest }, number) {
  const copy = structuredClone(json);
  for (const node of copy.nodes ?? []) {
    if (!node.extras?.parts?.includes(number)) {
      delete node.mesh;
      delete node.skin;
    }
  }
  let text = JSON.stringify(copy);
  let encoded = new TextEncoder().encode(text);
  text += " ".repeat((4 - (encoded.length % 4)) % 4);
  encoded = new TextEncoder().encode(text);
  const bytes = new Uint8Array(20 + encoded.length + rest.length);
  const view = new DataView(bytes.buffer);
  bytes.set([0x67, 0x6c, 0x54, 0x46]);
  view.setUint32(4, 2, true);
  view.setUint32(8, bytes.length, true);
  view.setUint32(12, encoded.length, true);
  view.setUint32(16, JSON_CHUNK, true);
  bytes.set(encoded, 20);
  bytes.set(rest, 20 + encoded.length);
  return bytes.buffer;
}
