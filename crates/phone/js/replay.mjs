// Replays a file of messages in Node: node replay.mjs MODULE FILE FOLDER. Answers go to the output as `feed replay` prints them, files
// that the module keeps into the folder, times to the error output: of images, and of the slices of mapping that one may have to wait for.

import { mkdirSync, openSync, readFileSync, readSync, writeFileSync, writeSync } from "node:fs";
import { dirname, join } from "node:path";
import { Engine } from "./engine.mjs";

const WORK = "W".charCodeAt(0);
const [, , modulePath, feedPath, folder] = process.argv;
const engine = await Engine.start(await WebAssembly.compile(readFileSync(modulePath)), {
    print: (text) => process.stderr.write(text),
});
const feed = openSync(feedPath);
const head = Buffer.alloc(5);
const [images, slices] = [[], []];
while (readSync(feed, head) === 5) {
    const content = new Uint8Array(head.readUInt32LE(1));
    for (let done = 0; done < content.length;) {
        const read = readSync(feed, content, done, content.length - done);
        if (read === 0) {
            throw new Error(`${feedPath} was cut off`);
        }
        done += read;
    }
    const began = performance.now();
    const answer = engine.send(String.fromCharCode(head[0]), content);
    const ms = performance.now() - began;
    if (head[0] === WORK) {
        slices.push(ms);
        continue;
    }
    if (answer.reports.length > 0) {
        images.push(ms);
    }
    writeSync(1, `${JSON.stringify(answer)}\n`);
}
const told = (times) => {
    times.sort((a, b) => a - b);
    const at = (share) => (times[Math.floor(share * times.length)] ?? 0).toFixed(1);
    const sum = times.reduce((a, b) => a + b, 0) / 1000;
    return `p50 ${at(0.5)} ms, p95 ${at(0.95)} ms, p99 ${at(0.99)} ms, longest ${at(1 - 1e-9)} ms, in all ${sum.toFixed(1)} s`;
};
const megabytes = (engine.exports.memory.buffer.byteLength / 1048576).toFixed(0);
console.error(`${images.length} images: ${told(images)}; ${megabytes} MB of memory`);
console.error(`${slices.length} slices of mapping: ${told(slices)}`);
for (const [path, file] of engine.wasi.files) {
    const to = join(folder, path);
    mkdirSync(dirname(to), { recursive: true });
    writeFileSync(to, file.data());
}
