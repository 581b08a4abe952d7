// The engine and the guide, as a module that runs wherever JavaScript does.

import { Wasi } from "./wasi.mjs";

export class Engine {
    // `module` is a compiled WebAssembly.Module; what may be given beside it is what `Wasi` takes.
    static async start(module, surroundings = {}) {
        const engine = new Engine();
        engine.wasi = new Wasi(surroundings);
        const instance = await WebAssembly.instantiate(module, { wasi_snapshot_preview1: engine.wasi.imports });
        engine.exports = instance.exports;
        engine.wasi.attach(engine.exports.memory);
        engine.exports._initialize?.();
        return engine;
    }

    // Sends a message (its kind, a letter, and its content in parts), and returns the answer.
    send(kind, ...parts) {
        const length = parts.reduce((sum, part) => sum + part.byteLength, 0);
        const at = this.exports.cairn_content(length);
        let to = new Uint8Array(this.exports.memory.buffer, at, length);
        for (const part of parts) {
            to.set(new Uint8Array(part.buffer, part.byteOffset, part.byteLength));
            to = to.subarray(part.byteLength);
        }
        const answered = this.exports.cairn_apply(kind.charCodeAt(0));
        const answer = new Uint8Array(this.exports.memory.buffer, this.exports.cairn_answer(), answered);
        return JSON.parse(new TextDecoder().decode(answer));
    }

    setup(setup) {
        return this.send("S", new TextEncoder().encode(JSON.stringify(setup)));
    }

    // Readings of the motion sensors: seconds, three rad/s, three m/s^2, one after the other.
    motion(readings) {
        return this.send("M", Float64Array.from(readings));
    }

    // A gray image and the second it was taken.
    image(seconds, gray) {
        return this.send("I", Float64Array.of(seconds), gray);
    }

    // Time without an image.
    tick(seconds) {
        return this.send("T", Float64Array.of(seconds));
    }

    // The map as bytes: the whole of it, or what has changed since the last.
    map(whole) {
        this.send("V", Uint8Array.of(whole ? 1 : 0));
        return this.exports.memory.buffer.slice(this.exports.cairn_map(), this.exports.cairn_map() + this.exports.cairn_map_length());
    }

    command(line) {
        return this.send("C", new TextEncoder().encode(line));
    }

    end() {
        return this.send("E");
    }
}
