// Archives as `tar` writes and reads them (POSIX ustar): plain files alone.

const BLOCK = 512;
const text = new TextEncoder();
const octal = (value, digits) => `${value.toString(8).padStart(digits, '0')}\0`;
const whole = (length) => Math.ceil(length / BLOCK) * BLOCK;

function head(name, length) {
  const block = new Uint8Array(BLOCK);
  const put = (at, value) => block.set(text.encode(value), at);
  put(0, name);
  [[100, octal(0o644, 7)], [108, octal(0, 7)], [116, octal(0, 7)], [124, octal(length, 11)], [136, octal(Math.floor(Date.now() / 1000), 11)]]
    .forEach(([at, value]) => put(at, value));
  put(148, '        ');
  put(156, '0');
  put(257, 'ustar\x0000');
  put(148, octal(block.reduce((sum, byte) => sum + byte, 0), 6));
  return block;
}

// The archive of files, given as names and bytes, behind `before` bytes of another's.
export function pack(files, before = 0) {
  const length = files.reduce((sum, [, bytes]) => sum + BLOCK + whole(bytes.length), 2 * BLOCK);
  const archive = new Uint8Array(before + length);
  let at = before;
  for (const [name, bytes] of files) {
    archive.set(head(name, bytes.length), at);
    archive.set(bytes, at + BLOCK);
    at += BLOCK + whole(bytes.length);
  }
  return archive;
}

// The files in an archive; null where it is none, or was cut off.
export function unpack(archive) {
  const files = [];
  const field = (block, from, to) => new TextDecoder().decode(block.subarray(from, to)).split('\0')[0].trim();
  for (let at = 0; at + BLOCK <= archive.length;) {
    const block = archive.subarray(at, at + BLOCK);
    if (block.every((byte) => byte === 0)) return files;
    const sum = block.reduce((all, byte, k) => all + (k >= 148 && k < 156 ? 32 : byte), 0);
    const length = parseInt(field(block, 124, 136), 8);
    if (parseInt(field(block, 148, 156), 8) !== sum || at + BLOCK + length > archive.length) return null;
    const kind = field(block, 156, 157);
    if (kind === '0' || kind === '') files.push([field(block, 0, 100), archive.slice(at + BLOCK, at + BLOCK + length)]);
    at += BLOCK + whole(length);
  }
  return null;
}
