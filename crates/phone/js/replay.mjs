// Replays a file of messages in Node: node replay.mjs MODULE FILE FOLDER. Answers go to the output as `feed replay` prints them, files
// that the module keeps into the folder.

import { mkdirSync, openSync, readFileSync, readSync, writeFileSync, writeSync } from "node:fs";
import { dirname, join } from "node:path";
import { Engine } from "./engine.mjs";

const [, , modulePath, feedPath, folder] = process.argv;
const engine = await Engine.start(await WebAssembly.compile(readFileSync(modulePath)), {
    print: (text) => process.stderr.write(text),
});
const feed = openSync(feedPath);
const head = Buffer.alloc(5);
const times = [];
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
    if (answer.reports.length > 0) {
        times.push(performance.now() - began);
    }
    writeSync(1, `${JSON.stringify(answer)}\n`);
}
times.sort((a, b) => a - b);
const at = (share) => (times[Math.floor(share * times.length)] ?? 0).toFixed(1);
const megabytes = (engine.exports.memory.buffer.byteLength / 1048576).toFixed(0);
console.error(`${times.length} images: p50 ${at(0.5)} ms, p95 ${at(0.95)} ms; ${megabytes} MB of memory`);
for (const [path, file] of engine.wasi.files) {
    const to = join(folder, path);
    mkdirSync(dirname(to), { recursive: true });
    writeFileSync(to, file.data());
}
