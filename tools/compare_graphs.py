#!/usr/bin/env python3
"""Pairs cairn's pose graphs with GTSAM and g2o on the same files: costs in the same convention, and times on one core.

    pip install gtsam g2o-python scipy 'numpy<2'
    cargo build --release -p cairn-cli -p bench
    taskset -c 0 python3 tools/compare_graphs.py FOLDER [--repeat 7] [--only NAME]

FOLDER holds g2o files. All start from odometry, chained along the edges between neighbours in id. Costs are half the sum
of squared whitened residuals. GTSAM's residuals in space and g2o's in the plane are those of cairn's default (the Lie
logarithm; x, y, angle). GTSAM takes the Lie logarithm in the plane too, and g2o in space the sine of half the angle, so that
only times are comparable there. Times are the
least of the repetitions, without reading the file, but for cairn's time on the processor, which is that of the whole process.
What is not installed is left out aloud.

Where scipy is there, the optimum of SE-Sync's objective (Rosen et al. 2019, problem 1) that cairn reaches with
`--cost se-sync` is certified as the global one: the least eigenvalue of its certificate matrix (theorem 7)
must not be negative beyond rounding.
"""
import argparse
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CAIRN = ROOT / "target" / "release" / "cairn"


def least(repeat, run):
    """The least seconds (wall, processor) of some repetitions, and the last result. `run` gives the timed part."""
    wall, cpu, result = float("inf"), float("inf"), None
    for _ in range(repeat):
        work = run()
        began, ran = time.perf_counter(), time.process_time()
        result = work()
        wall, cpu = min(wall, time.perf_counter() - began), min(cpu, time.process_time() - ran)
    return (wall, cpu), result


def edges_of(file):
    """Edges as (a, b, numbers), and whether they are in space."""
    edges, space = [], False
    for line in file.read_text().splitlines():
        words = line.split()
        if words and words[0] in ("EDGE_SE2", "EDGE_SE3:QUAT"):
            space = words[0] == "EDGE_SE3:QUAT"
            edges.append((int(words[1]), int(words[2]), [float(w) for w in words[3:]]))
    return edges, space


def gtsam_runs(file, repeat):
    import gtsam
    import numpy as np

    edges, space = edges_of(file)
    graph, chain = gtsam.NonlinearFactorGraph(), {}
    for a, b, v in edges:
        size, first = (6, 7) if space else (3, 3)
        info = np.zeros((size, size))
        info[np.triu_indices(size)] = v[first:]
        info = info + info.T - np.diag(np.diag(info))
        if space:
            pose = gtsam.Pose3(gtsam.Rot3.Quaternion(v[6], v[3], v[4], v[5]), gtsam.Point3(*v[:3]))
            order = [3, 4, 5, 0, 1, 2]
            info = info[np.ix_(order, order)]
            factor = gtsam.BetweenFactorPose3
        else:
            pose, factor = gtsam.Pose2(*v[:3]), gtsam.BetweenFactorPose2
        graph.add(factor(a, b, pose, gtsam.noiseModel.Gaussian.Information(info)))
        if b - a == 1:
            chain.setdefault(b, pose)
    ids = sorted({i for a, b, _ in edges for i in (a, b)})
    pose = gtsam.Pose3() if space else gtsam.Pose2()
    start = gtsam.Values()
    for k, i in enumerate(ids):
        pose = pose if k == 0 else pose.compose(chain[i])
        start.insert(i, pose)
    first = gtsam.Pose3() if space else gtsam.Pose2()
    pin = gtsam.NonlinearEqualityPose3 if space else gtsam.NonlinearEqualityPose2
    graph.add(pin(ids[0], first))

    def make(kind):
        def run():
            if kind == "gn":
                p = gtsam.GaussNewtonParams()
                optimizer = gtsam.GaussNewtonOptimizer
            else:
                p = gtsam.LevenbergMarquardtParams()
                optimizer = gtsam.LevenbergMarquardtOptimizer
            p.setRelativeErrorTol(1e-9)
            p.setAbsoluteErrorTol(0)
            p.setMaxIterations(100)
            p.setOrderingType("COLAMD")
            return optimizer(graph, start, p).optimize
        return run

    for kind in ("gn", "lm"):
        try:
            seconds, values = least(repeat, make(kind))
        except RuntimeError as e:
            print(f"    gtsam {kind}: {str(e).splitlines()[0]}")
            continue
        yield f"gtsam {kind}", seconds, graph.error(values)
    # The same function: what GTSAM says of cairn's poses.
    try:
        poses = cairn_poses(file)
    except (FileNotFoundError, subprocess.CalledProcessError):
        return
    values = gtsam.Values()
    anchor = None
    for k, i in enumerate(ids):
        v = poses[i]
        pose = gtsam.Pose3(gtsam.Rot3.Quaternion(v[6], v[3], v[4], v[5]), gtsam.Point3(*v[:3])) if space \
            else gtsam.Pose2(*v[:3])
        anchor = pose if k == 0 else anchor
        values.insert(i, anchor.inverse().compose(pose))
    yield "gtsam of cairn's poses", None, graph.error(values)


def g2o_runs(file, repeat):
    import g2o
    import numpy as np

    if int(np.__version__.split(".")[0]) >= 2:
        raise ImportError("g2o-python 0.0.12 crashes with numpy 2: pip install 'numpy<2'")
    edges, space = edges_of(file)
    ids = sorted({i for a, b, _ in edges for i in (a, b)})
    wrap = g2o.Isometry3d if space else (lambda m: g2o.SE2(m[0, 2], m[1, 2], np.arctan2(m[1, 0], m[0, 0])))
    size, first = (6, 7) if space else (3, 3)
    measured = []
    for a, b, v in edges:
        info = np.zeros((size, size))
        info[np.triu_indices(size)] = v[first:]
        measured.append((a, b, pose_matrix(v, space), info + info.T - np.diag(np.diag(info))))
    chain = {}
    for a, b, m, _ in measured:
        if b - a == 1:
            chain.setdefault(b, m)

    def make(kind):
        def run():
            algorithm = g2o.OptimizationAlgorithmGaussNewton if kind == "gn" else g2o.OptimizationAlgorithmLevenberg
            linear = (g2o.LinearSolverEigenSE3 if space else g2o.LinearSolverEigenSE2)()
            block = (g2o.BlockSolverSE3 if space else g2o.BlockSolverSE2)(linear)
            optimizer = g2o.SparseOptimizer()
            optimizer.set_algorithm(algorithm(block))
            pose = np.eye(4 if space else 3)
            vertices = {}
            for k, i in enumerate(ids):
                pose = pose if k == 0 else pose @ chain[i]
                vertex = vertices[i] = g2o.VertexSE3() if space else g2o.VertexSE2()
                vertex.set_id(i)
                vertex.set_estimate(wrap(pose))
                vertex.set_fixed(k == 0)
                optimizer.add_vertex(vertex)
            kept = []
            for a, b, m, info in measured:
                edge = g2o.EdgeSE3() if space else g2o.EdgeSE2()
                edge.set_vertex(0, vertices[a])
                edge.set_vertex(1, vertices[b])
                edge.set_measurement(wrap(m))
                edge.set_information(info)
                optimizer.add_edge(edge)
                kept.append(edge)
            optimizer.initialize_optimization()

            def work():
                # As long as the cost falls: it has no rule of its own for when to stop.
                before = float("inf")
                for _ in range(30):
                    optimizer.optimize(1)
                    optimizer.compute_active_errors()
                    now = optimizer.active_chi2()
                    if abs(before - now) <= 1e-9 * now:
                        break
                    before = now
                return optimizer.active_chi2()

            return work
        return run

    for kind in ("gn", "lm"):
        seconds, chi2 = least(repeat, make(kind))
        yield f"g2o {kind}" + (" (its own residuals)" if space else ""), seconds, 0.5 * chi2


def cairn_poses(file):
    """Numbers of each vertex as cairn solves it."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out.g2o"
        subprocess.run([CAIRN, "solve", "graph", file, "--init", "odometry", "--out", out],
                       capture_output=True, check=True)
        lines = (line.split() for line in out.read_text().splitlines())
        return {int(w[1]): [float(v) for v in w[2:]] for w in lines if w[0].startswith("VERTEX")}


def cairn_runs(file, repeat):
    for kind in ("gn", "lm"):
        wall, cpu = float("inf"), float("inf")
        for _ in range(repeat):
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            out = subprocess.run([CAIRN, "solve", "graph", file, "--method", kind, "--init", "odometry", "--json"],
                                 capture_output=True, text=True, check=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            told = json.loads(out.stdout)
            wall = min(wall, told["seconds"])
            cpu = min(cpu, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
        yield f"cairn {kind}", (wall, cpu), told["cost_after"]


def certify(file):
    """SE-Sync's certificate at cairn's optimum of its objective."""
    import tempfile

    import numpy as np
    import scipy.sparse as sp
    from scipy.sparse.linalg import splu

    edges, space = edges_of(file)
    ids = {i: k for k, i in enumerate(sorted({i for a, b, _ in edges for i in (a, b)}))}
    n, d = len(ids), 3 if space else 2
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out.g2o"
        told = subprocess.run([CAIRN, "solve", "graph", file, "--init", "odometry", "--cost", "se-sync",
                               "--out", out, "--json"], capture_output=True, text=True, check=True)
        told = json.loads(told.stdout)
        poses = {}
        for line in out.read_text().splitlines():
            words = line.split()
            if words[0].startswith("VERTEX"):
                poses[ids[int(words[1])]] = pose_matrix([float(w) for w in words[2:]], space)
    # The connection Laplacian of translations and rotations: blocks of one (translation) and d (rotation) columns.
    rows, cols, vals = [], [], []

    def put(r, c, v):
        rows.append(r), cols.append(c), vals.append(v)

    cost = 0.0
    for a, b, v in edges:
        a, b = ids[a], ids[b]
        m = pose_matrix(v, space)
        R, t = m[:d, :d], m[:d, d]
        tau, kappa = weights(v, space)
        Ra, ta, Rb, tb = poses[a][:d, :d], poses[a][:d, d], poses[b][:d, :d], poses[b][:d, d]
        cost += kappa * np.sum((Rb - Ra @ R) ** 2) + tau * np.sum((tb - ta - Ra @ t) ** 2)
        # X = [t_1 .. t_n | R_1 .. R_n]; the residuals are X times columns.
        for weight, entries in [(tau, {b: 1.0, a: -1.0, **{n + d * a + k: -t[k] for k in range(d)}})] + [
            (kappa, {n + d * b + j: 1.0, **{n + d * a + k: -R[k, j] for k in range(d)}}) for j in range(d)
        ]:
            for r, x in entries.items():
                for c, y in entries.items():
                    put(r, c, weight * x * y)
    size = n * (d + 1)
    Q = sp.coo_matrix((vals, (rows, cols)), shape=(size, size)).tocsc()
    X = np.zeros((d, size))
    for k, m in poses.items():
        X[:, k] = m[:d, d]
        X[:, n + d * k:n + d * k + d] = m[:d, :d]
    XQ = (Q @ X.T).T
    blocks = []
    for k in range(n):
        R, G = X[:, n + d * k:n + d * k + d], XQ[:, n + d * k:n + d * k + d]
        L = R.T @ G
        blocks.append(0.5 * (L + L.T))
    S = (Q - sp.block_diag([sp.csc_matrix((n, n))] + blocks, format="csc")).tocsc()
    gradient = np.linalg.norm((S @ X.T).T)
    # S has the poses in its kernel; with a small shift it must have a Cholesky factor: all pivots positive.
    for shift in (1e-9, 1e-8, 1e-7, 1e-6, 1e-5):
        lu = splu(S + sp.identity(size, format="csc") * shift * abs(S.diagonal()).max(), permc_spec="MMD_AT_PLUS_A",
                  diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        straight = np.array_equal(lu.perm_r, lu.perm_c)
        if straight and (lu.U.diagonal() > 0).all():
            break
    else:
        return cost, told["chi2_after"], gradient, None
    return cost, told["chi2_after"], gradient, shift


def pose_matrix(v, space):
    import numpy as np

    if not space:
        c, s = np.cos(v[2]), np.sin(v[2])
        return np.array([[c, -s, v[0]], [s, c, v[1]], [0, 0, 1]])
    x, y, z, w = np.array(v[3:7]) / np.linalg.norm(v[3:7])
    m = np.eye(4)
    m[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                 [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                 [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    m[:3, 3] = v[:3]
    return m


def weights(v, space):
    """SE-Sync's weights of translation and rotation for an information matrix."""
    import numpy as np

    if space:
        info = np.zeros((6, 6))
        info[np.triu_indices(6)] = v[7:]
        info = info + info.T - np.diag(np.diag(info))
        return 3 / np.trace(np.linalg.inv(info[:3, :3])), 3 / (2 * np.trace(np.linalg.inv(info[3:, 3:])))
    return 2 / np.trace(np.linalg.inv(np.array([[v[3], v[4]], [v[4], v[6]]]))), v[8]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--only", default="")
    arguments = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"
    for file in sorted(arguments.folder.glob("*.g2o")):
        if arguments.only not in file.name:
            continue
        print(file.name)
        for runs in (cairn_runs, gtsam_runs, g2o_runs):
            try:
                for name, seconds, cost in runs(file, arguments.repeat):
                    told = f"{1e3 * seconds[0]:9.2f} ms, processor {1e3 * seconds[1]:9.2f} ms" if seconds else " " * 36
                    print(f"    {name:<30} {told}  cost {cost:.9f}")
            except ImportError as e:
                print(f"    left out: {e}")
            except (FileNotFoundError, subprocess.CalledProcessError) as e:
                print(f"    left out: {e}")
        try:
            cost, told, gradient, shift = certify(file)
            verdict = f"global optimum (shift {shift:.0e})" if shift else "NOT certified"
            print(f"    SE-Sync's objective {cost:.9f}, told {told:.9f}, gradient {gradient:.1e}: {verdict}")
        except ImportError as e:
            print(f"    certificate left out: {e}")
        except (FileNotFoundError, subprocess.CalledProcessError) as e:
            print(f"    certificate left out: {e}")


if __name__ == "__main__":
    sys.exit(main())
