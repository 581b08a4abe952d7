// What the module asks of its surroundings (WASI preview 1): a clock, random numbers, and files in memory.
// Files are flat names in a Map; what is written is there for `files` to keep elsewhere.

const OK = 0, BADF = 8, EXIST = 20, INVAL = 28, NOENT = 44, NOSYS = 52, NOTDIR = 54, NOTEMPTY = 55;
const DIRECTORY = 3, REGULAR = 4, CHARACTER = 2;
const CREATE = 1, ONLY_DIRECTORY = 2, EXCLUSIVE = 4, TRUNCATE = 8;
const APPEND = 1;

class File {
    bytes = new Uint8Array(0);
    length = 0;

    resize(length) {
        if (length > this.bytes.length) {
            const grown = new Uint8Array(Math.max(length, 2 * this.bytes.length));
            grown.set(this.bytes.subarray(0, this.length));
            this.bytes = grown;
        } else if (length < this.length) {
            this.bytes.fill(0, length, this.length);
        }
        this.length = length;
    }

    data() {
        return this.bytes.subarray(0, this.length);
    }
}

export class Wasi {
    // `print(text)` takes what the module writes to its output and error streams; `changed(path)` is told of each file that was
    // written, renamed or removed.
    constructor({ print = () => {}, changed = () => {} } = {}) {
        this.print = print;
        this.changed = changed;
        this.files = new Map();
        this.folders = new Set([""]);
        this.open = new Map([[3, { path: "" }]]);
        this.next = 4;
        this.text = new TextDecoder();
        const calls = {};
        for (const name of Object.getOwnPropertyNames(Wasi.prototype)) {
            if (/^[a-z]+_[a-z_]+$/.test(name)) {
                calls[name] = (...values) => this[name](...values);
            }
        }
        // What nobody needs is refused, by name.
        this.imports = new Proxy(calls, { get: (all, name) => all[name] ?? (() => NOSYS) });
    }

    attach(memory) {
        this.memory = memory;
    }

    view() {
        return new DataView(this.memory.buffer);
    }

    bytes(at, length) {
        return new Uint8Array(this.memory.buffer, at, length);
    }

    path(folder, at, length) {
        const parts = [];
        const text = `${this.open.get(folder)?.path ?? ""}/${this.text.decode(this.bytes(at, length))}`;
        for (const part of text.split("/")) {
            if (part === "..") {
                parts.pop();
            } else if (part !== "" && part !== ".") {
                parts.push(part);
            }
        }
        return parts.join("/");
    }

    put(path, data) {
        const file = new File();
        file.resize(data.length);
        file.bytes.set(data);
        this.files.set(path, file);
        for (let end = path.lastIndexOf("/"); end > 0; end = path.lastIndexOf("/", end - 1)) {
            this.folders.add(path.slice(0, end));
        }
    }

    environ_sizes_get(count, size) {
        this.view().setUint32(count, 0, true);
        this.view().setUint32(size, 0, true);
        return OK;
    }

    environ_get() {
        return OK;
    }

    args_sizes_get(count, size) {
        return this.environ_sizes_get(count, size);
    }

    args_get() {
        return OK;
    }

    clock_time_get(id, _precision, at) {
        const ms = id === 0 ? Date.now() : performance.now();
        this.view().setBigUint64(at, BigInt(Math.round(ms * 1e6)), true);
        return OK;
    }

    random_get(at, length) {
        for (let done = 0; done < length; done += 65536) {
            crypto.getRandomValues(this.bytes(at + done, Math.min(65536, length - done)));
        }
        return OK;
    }

    sched_yield() {
        return OK;
    }

    proc_exit(code) {
        throw new Error(`the module ended with ${code}`);
    }

    fd_prestat_get(fd, at) {
        if (fd !== 3) {
            return BADF;
        }
        this.view().setUint32(at, 0, true);
        this.view().setUint32(at + 4, 1, true);
        return OK;
    }

    fd_prestat_dir_name(fd, at) {
        if (fd !== 3) {
            return BADF;
        }
        this.bytes(at, 1)[0] = 0x2f;
        return OK;
    }

    fd_fdstat_get(fd, at) {
        const open = this.open.get(fd);
        if (fd > 2 && !open) {
            return BADF;
        }
        const view = this.view();
        view.setUint8(at, fd <= 2 ? CHARACTER : open.file ? REGULAR : DIRECTORY);
        view.setUint16(at + 2, open?.append ? APPEND : 0, true);
        view.setBigUint64(at + 8, ~0n & 0xffffffffffffffffn, true);
        view.setBigUint64(at + 16, ~0n & 0xffffffffffffffffn, true);
        return OK;
    }

    fd_fdstat_set_flags() {
        return OK;
    }

    filestat(at, file) {
        const view = this.view();
        this.bytes(at, 64).fill(0);
        view.setUint8(at + 16, file ? REGULAR : DIRECTORY);
        view.setBigUint64(at + 24, 1n, true);
        view.setBigUint64(at + 32, BigInt(file?.length ?? 0), true);
        const modified = BigInt(Math.round((file?.modified ?? 0) * 1e6));
        [40, 48, 56].forEach((offset) => view.setBigUint64(at + offset, modified, true));
        return OK;
    }

    fd_filestat_get(fd, at) {
        const open = this.open.get(fd);
        return open ? this.filestat(at, open.file) : BADF;
    }

    path_filestat_get(folder, _flags, pathAt, length, at) {
        const path = this.path(folder, pathAt, length);
        if (this.files.has(path)) {
            return this.filestat(at, this.files.get(path));
        }
        return this.folders.has(path) ? this.filestat(at, null) : NOENT;
    }

    fd_filestat_set_size(fd, size) {
        const file = this.open.get(fd)?.file;
        if (!file) {
            return BADF;
        }
        file.resize(Number(size));
        return OK;
    }

    path_open(folder, _lookup, pathAt, length, flags, _rights, _inheriting, fdFlags, at) {
        const path = this.path(folder, pathAt, length);
        let file = this.files.get(path);
        if (file && flags & EXCLUSIVE) {
            return EXIST;
        }
        if (file && flags & ONLY_DIRECTORY) {
            return NOTDIR;
        }
        const isFolder = this.folders.has(path);
        if (!file && !isFolder) {
            if (!(flags & CREATE)) {
                return NOENT;
            }
            const parent = path.slice(0, Math.max(path.lastIndexOf("/"), 0));
            if (!this.folders.has(parent)) {
                return NOENT;
            }
            file = new File();
            file.modified = Date.now();
            this.files.set(path, file);
        }
        if (file && flags & TRUNCATE) {
            file.resize(0);
        }
        const fd = this.next++;
        this.open.set(fd, { path, file, at: 0, append: (fdFlags & APPEND) !== 0, written: false });
        this.view().setUint32(at, fd, true);
        return OK;
    }

    fd_close(fd) {
        const open = this.open.get(fd);
        if (!open) {
            return BADF;
        }
        this.open.delete(fd);
        if (open.written) {
            this.changed(open.path);
        }
        return OK;
    }

    fd_sync(fd) {
        const open = this.open.get(fd);
        if (open?.written) {
            open.written = false;
            this.changed(open.path);
        }
        return open ? OK : BADF;
    }

    fd_datasync(fd) {
        return this.fd_sync(fd);
    }

    // Pieces of memory, [start, length] each.
    *pieces(at, count) {
        for (let k = 0; k < count; k++) {
            const view = this.view();
            yield [view.getUint32(at + 8 * k, true), view.getUint32(at + 8 * k + 4, true)];
        }
    }

    fd_write(fd, at, count, writtenAt) {
        const open = this.open.get(fd);
        if (fd > 2 && !open?.file) {
            return BADF;
        }
        let written = 0;
        for (const [start, length] of this.pieces(at, count)) {
            const from = this.bytes(start, length);
            if (fd <= 2) {
                this.print(this.text.decode(from));
            } else {
                const to = open.append ? open.file.length : open.at;
                open.file.resize(Math.max(open.file.length, to + length));
                open.file.bytes.set(from, to);
                open.at = to + length;
                [open.written, open.file.modified] = [true, Date.now()];
            }
            written += length;
        }
        this.view().setUint32(writtenAt, written, true);
        return OK;
    }

    read(file, from, at, count, readAt) {
        let read = 0;
        for (const [start, length] of this.pieces(at, count)) {
            const part = file.data().subarray(from + read, from + read + length);
            this.bytes(start, part.length).set(part);
            read += part.length;
        }
        this.view().setUint32(readAt, read, true);
        return read;
    }

    fd_read(fd, at, count, readAt) {
        const open = this.open.get(fd);
        if (!open?.file) {
            return BADF;
        }
        open.at += this.read(open.file, open.at, at, count, readAt);
        return OK;
    }

    fd_pread(fd, at, count, offset, readAt) {
        const open = this.open.get(fd);
        if (!open?.file) {
            return BADF;
        }
        this.read(open.file, Number(offset), at, count, readAt);
        return OK;
    }

    fd_seek(fd, offset, whence, at) {
        const open = this.open.get(fd);
        if (!open?.file) {
            return BADF;
        }
        const to = [0, open.at, open.file.length][whence] + Number(offset);
        if (!(to >= 0)) {
            return INVAL;
        }
        open.at = to;
        this.view().setBigUint64(at, BigInt(to), true);
        return OK;
    }

    fd_readdir(fd, at, length, cookie, usedAt) {
        const open = this.open.get(fd);
        if (!open || open.file) {
            return BADF;
        }
        const inside = open.path === "" ? "" : `${open.path}/`;
        const names = (all) => [...all].filter((path) => path !== "" && path.startsWith(inside)
            && !path.slice(inside.length).includes("/")).map((path) => path.slice(inside.length));
        const entries = [...names(this.folders).map((name) => [name, DIRECTORY]),
            ...names(this.files.keys()).map((name) => [name, REGULAR])].sort();
        let used = 0;
        for (let k = Number(cookie); k < entries.length && used < length; k++) {
            const [name, type] = entries[k];
            const utf8 = new TextEncoder().encode(name);
            const entry = new Uint8Array(24 + utf8.length);
            const view = new DataView(entry.buffer);
            view.setBigUint64(0, BigInt(k + 1), true);
            view.setBigUint64(8, BigInt(k + 1), true);
            view.setUint32(16, utf8.length, true);
            view.setUint8(20, type);
            entry.set(utf8, 24);
            const part = entry.subarray(0, length - used);
            this.bytes(at + used, part.length).set(part);
            used += part.length;
        }
        this.view().setUint32(usedAt, used, true);
        return OK;
    }

    path_create_directory(folder, at, length) {
        const path = this.path(folder, at, length);
        if (this.files.has(path) || this.folders.has(path)) {
            return EXIST;
        }
        this.folders.add(path);
        return OK;
    }

    path_remove_directory(folder, at, length) {
        const path = this.path(folder, at, length);
        if (!this.folders.has(path)) {
            return NOENT;
        }
        if ([...this.files.keys(), ...this.folders].some((other) => other.startsWith(`${path}/`))) {
            return NOTEMPTY;
        }
        this.folders.delete(path);
        return OK;
    }

    path_unlink_file(folder, at, length) {
        const path = this.path(folder, at, length);
        if (!this.files.delete(path)) {
            return NOENT;
        }
        this.changed(path);
        return OK;
    }

    path_rename(folder, at, length, newFolder, newAt, newLength) {
        const [from, to] = [this.path(folder, at, length), this.path(newFolder, newAt, newLength)];
        const file = this.files.get(from);
        if (!file) {
            return NOENT;
        }
        this.files.set(to, file);
        if (from !== to) {
            this.files.delete(from);
        }
        [from, to].forEach((path) => this.changed(path));
        return OK;
    }
}
