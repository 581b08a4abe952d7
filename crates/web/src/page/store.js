// Keeps files in the browser's private file system, whole whenever the page is ended.
//
// A file is written under a new name each time, its SHA-256 in front, and the one before is removed once it is there; a name is
// a number and the path. What was cut off does not fit its sum: then the one before counts.

const SUM = 32;

const sumOf = async (bytes) => new Uint8Array(await crypto.subtle.digest('SHA-256', bytes));
const equal = (a, b) => a.length === b.length && a.every((value, k) => value === b[k]);

export class Store {
  // `failed` is told why a file could not be kept.
  constructor(folder, failed) {
    // Of each path the numbers that are there, in order.
    Object.assign(this, { folder, failed, numbers: new Map(), next: 0, work: Promise.resolve() });
  }

  // The store of this origin and the files in it, by their paths.
  static async open(failed) {
    const root = await navigator.storage.getDirectory();
    const store = new Store(await root.getDirectoryHandle('cairn', { create: true }), failed);
    return [store, await store.read()];
  }

  async read() {
    for await (const name of this.folder.keys()) {
      const [, number, path] = /^(\d+)~(.*)$/.exec(name) ?? [];
      if (path === undefined) continue;
      this.next = Math.max(this.next, Number(number) + 1);
      const key = decodeURIComponent(path);
      this.numbers.set(key, [...this.numbers.get(key) ?? [], Number(number)].sort((a, b) => a - b));
    }
    const files = new Map();
    for (const [path, numbers] of this.numbers) {
      for (const number of [...numbers].reverse()) {
        const bytes = files.has(path) ? null : await this.whole(number, path);
        if (bytes) files.set(path, bytes);
        else await this.remove(path, number);
      }
    }
    return files;
  }

  name(number, path) {
    return `${number}~${encodeURIComponent(path)}`;
  }

  async whole(number, path) {
    const file = await (await this.folder.getFileHandle(this.name(number, path))).getFile();
    const bytes = new Uint8Array(await file.arrayBuffer());
    const content = bytes.subarray(SUM);
    return equal(bytes.subarray(0, SUM), await sumOf(content)) ? content : null;
  }

  async remove(path, number) {
    await this.folder.removeEntry(this.name(number, path));
    const left = this.numbers.get(path).filter((other) => other !== number);
    if (left.length > 0) this.numbers.set(path, left);
    else this.numbers.delete(path);
  }

  // Keeps files, one after the other in this order; a path without bytes is removed. Resolves once they are kept.
  keep(files) {
    for (const [path, bytes] of files) {
      this.work = this.work.then(() => this.keepOne(path, bytes)).catch((error) => this.failed(error));
    }
    return this.work;
  }

  // Keeps files in place of all others, which go once these are there; whether they could be kept. Where not, the others stay.
  replace(files) {
    const given = new Set(files.map(([path]) => path));
    const all = async () => {
      for (const [path, bytes] of files) await this.keepOne(path, bytes);
      for (const path of [...this.numbers.keys()]) if (!given.has(path)) await this.keepOne(path, null);
      return true;
    };
    const done = this.work.then(all).catch((error) => {
      this.failed(error);
      return false;
    });
    this.work = done;
    return done;
  }

  async keepOne(path, bytes) {
    const before = this.numbers.get(path) ?? [];
    if (bytes) {
      const number = this.next;
      this.next += 1;
      const sum = await sumOf(bytes);
      const handle = await this.folder.getFileHandle(this.name(number, path), { create: true });
      this.numbers.set(path, [...before, number]);
      const file = await handle.createSyncAccessHandle();
      try {
        for (const [part, at] of [[sum, 0], [bytes, SUM]]) {
          if (file.write(part, { at }) !== part.length) throw new DOMException('no room', 'QuotaExceededError');
        }
        file.flush();
      } finally {
        file.close();
      }
    }
    // The oldest first: one that has been replaced never comes back.
    for (const number of before) await this.remove(path, number);
  }
}
