// A folder as one file: a zip without compression, which the readers of studies take.

const MOST_PACKED = 2 ** 31; // bytes, as the server takes of a file
const UTF8 = 0x800;
const CRC = Uint32Array.from({ length: 256 }, (_, n) => {
  let value = n;
  for (let k = 0; k < 8; k++) value = value & 1 ? 0xedb88320 ^ (value >>> 1) : value >>> 1;
  return value;
});

async function checksum(file) {
  let value = 0xffffffff;
  const reader = file.stream().getReader();
  for (let piece = await reader.read(); !piece.done; piece = await reader.read()) {
    for (const byte of piece.value) value = CRC[(value ^ byte) & 255] ^ (value >>> 8);
  }
  return (value ^ 0xffffffff) >>> 0;
}

// Numbers of 2 or 4 bytes, one after the other.
function packed(...fields) {
  const view = new DataView(new ArrayBuffer(fields.reduce((sum, [size]) => sum + size, 0)));
  let at = 0;
  for (const [size, value] of fields) {
    if (size === 2) view.setUint16(at, value, true);
    else view.setUint32(at, value, true);
    at += size;
  }
  return view.buffer;
}

// A zip named after the folder, of files {path, file} in the order of their paths: the same folder is the same file. Throws where they are too many or too large.
async function zipOf(name, files) {
  if (files.length > 65000 || files.reduce((sum, { file }) => sum + file.size, 0) > MOST_PACKED) throw new Error(`${name}: is larger than ${MOST_PACKED} bytes, or holds more than 65000 files: bring a part of it`);
  const [parts, index] = [[], []];
  let [at, length] = [0, 0];
  for (const { path, file } of [...files].sort((one, other) => (one.path < other.path ? -1 : 1))) {
    const title = new TextEncoder().encode(path);
    const shared = [[2, 20], [2, UTF8], [2, 0], [2, 0], [2, 0x21], [4, await checksum(file)], [4, file.size], [4, file.size], [2, title.length], [2, 0]];
    const head = packed([4, 0x04034b50], ...shared);
    const entry = packed([4, 0x02014b50], [2, 20], ...shared, [2, 0], [2, 0], [2, 0], [4, 0], [4, at]);
    parts.push(head, title, file);
    index.push(entry, title);
    at += head.byteLength + title.length + file.size;
    length += entry.byteLength + title.length;
  }
  const end = packed([4, 0x06054b50], [2, 0], [2, 0], [2, files.length], [2, files.length], [4, length], [4, at], [2, 0]);
  return new File([...parts, ...index, end], `${name}.zip`);
}

// The files of a folder that was dropped, however deep.
async function filesIn(entry) {
  if (entry.isFile) return [{ path: entry.fullPath.replace(/^\//, ""), file: await new Promise((done, failed) => { entry.file(done, failed); }) }];
  const reader = entry.createReader();
  const found = [];
  for (;;) {
    const some = await new Promise((done, failed) => { reader.readEntries(done, failed); });
    if (!some.length) return found; // a reader gives a hundred at a time
    for (const one of some) found.push(...await filesIn(one));
  }
}
