#!/usr/bin/env python3
"""How much two photographs of the folder `loops` overlap, by means that share nothing with Cairn's.

    tools/loops_overlap.py > crates/bench/src/places/overlap.txt

SIFT features, mutual best matches with a ratio of 0.75, a fundamental matrix by MAGSAC (OpenCV). Printed: a line for each
pair that is marked in the loop matrix, `later earlier inliers`, photographs counted from 1; and as a comment the most
inliers of any pair at least 20 apart that is not marked. Needs: pip install opencv-python-headless numpy; recordings in
CAIRN_DATA (default ../shared/data).
"""

import os
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("CAIRN_DATA", ROOT / "../shared/data")) / "loops"
APART, RATIO, PIXELS = 20, 0.75, 1.5


def one_way(matcher, a, b):
    return {
        (m.queryIdx, m.trainIdx)
        for m, second in matcher.knnMatch(a, b, k=2)
        if m.distance < RATIO * second.distance
    }


def inliers(matcher, one, other):
    (keys_a, a), (keys_b, b) = one, other
    if a is None or b is None or len(keys_a) < 2 or len(keys_b) < 2:
        return 0
    back = {(i, j) for j, i in one_way(matcher, b, a)}
    pairs = sorted(one_way(matcher, a, b) & back)
    if len(pairs) < 8:
        return 0
    first = np.float32([keys_a[i].pt for i, _ in pairs])
    second = np.float32([keys_b[j].pt for _, j in pairs])
    try:
        _, mask = cv2.findFundamentalMat(first, second, cv2.USAC_MAGSAC, PIXELS, 0.9999, 5000)
    except cv2.error:
        return 0
    return 0 if mask is None else int(mask.sum())


def main():
    cv2.setRNGSeed(1)
    truth = cv2.imread(str(DATA / "samples_GT.bmp"), cv2.IMREAD_GRAYSCALE) > 127
    sift, matcher = cv2.SIFT_create(2000), cv2.BFMatcher()
    images = [cv2.imread(str(DATA / f"samples/{i + 1}.jpg"), cv2.IMREAD_GRAYSCALE) for i in range(len(truth))]
    seen = [sift.detectAndCompute(image, None) for image in images]
    unmarked = (0, 0, 0)
    for later in range(APART, len(truth)):
        for earlier in range(later - APART + 1):
            count = inliers(matcher, seen[later], seen[earlier])
            if truth[later, earlier]:
                print(later + 1, earlier + 1, count)
            else:
                unmarked = max(unmarked, (count, later + 1, earlier + 1))
    print(f"# not marked: at most {unmarked[0]} ({unmarked[1]} {unmarked[2]})")


if __name__ == "__main__":
    main()
