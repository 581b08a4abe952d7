// Compares the answers of two replays: node compare.mjs ONE OTHER. Words and states must be the same, positions to a millimetre (in metres,
// or in the map's unit). They are not the same to the last bit: sin, cos, tan, acos, atan, hypot, exp and pow of glibc and of wasi-libc
// differ by one unit in the last place for 0.05 to 15 % of arguments (20,000 of each), sqrt, ln and mul_add for none.

import { readFileSync } from "node:fs";

const MOST = 1e-3;
const [one, other] = process.argv.slice(2).map((path) => readFileSync(path, "utf8").trim().split("\n").map(JSON.parse));
let [images, posed, equal, farthest] = [0, 0, 0, 0];
const failures = [];
if (one.length !== other.length) {
    failures.push(`${one.length} answers and ${other.length}`);
}
for (let k = 0; k < Math.min(one.length, other.length); k++) {
    // The uncertainty that a state states differs as positions do.
    const rounded = (state) => JSON.stringify(state, (_, v) => (typeof v === "number" ? Number(v.toPrecision(6)) : v));
    const words = (answer) => JSON.stringify([answer.done, answer.error,
        answer.reports.map((r) => [r.t_s, rounded(r.state), r.metric, r.refused, r.said.map((s) => s.text), r.pose === null])]);
    if (words(one[k]) !== words(other[k])) {
        failures.push(`answer ${k}:\n  ${words(one[k])}\n  ${words(other[k])}`);
    }
    one[k].reports.forEach((report, i) => {
        images += report.state === null ? 0 : 1;
        const [a, b] = [report.pose, other[k].reports[i]?.pose];
        if (a && b) {
            posed += 1;
            equal += a.every((value, j) => value === b[j]) ? 1 : 0;
            farthest = Math.max(farthest, Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]));
        }
    });
}
if (!(farthest <= MOST)) {
    failures.push(`positions differ by ${farthest}`);
}
if (posed === 0) {
    failures.push("nothing was tracked");
}
console.log(`${images} images, ${posed} with a pose, ${equal} equal to the last bit, positions at most ${farthest.toExponential(1)} apart`);
failures.slice(0, 5).forEach((failure) => console.log(failure));
process.exit(failures.length === 0 ? 0 : 1);
