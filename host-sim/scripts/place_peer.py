#!/usr/bin/env python3
"""General solvers on the instances of the bench `place`: the maximal covering program over all candidate disks.

    maximise sum W_k y_k    y_k <= sum of x_j over disks j that cover class k    sum x_j <= m

Users whom the same disks cover are one class of weight W_k; disks that cover a part of what another one covers are
left out beforehand. HiGHS takes y as real numbers, CP-SAT as Booleans; both run on one thread.

Reads one JSON object {"drones": m, "disks": [[user, ...], ...], "limit_s": s} from standard input, prints one with the
value, the bound and the CPU seconds of each solver that is installed (highspy, ortools). Run by `cargo xtask bench place`.
"""

import json
import subprocess
import sys
import time
from collections import defaultdict


def classes_of(disks):
    """Classes of users as (weight, disks that cover it)."""
    covered_by = defaultdict(list)
    for j, users in enumerate(disks):
        for user in users:
            covered_by[user].append(j)
    weights = defaultdict(int)
    for columns in covered_by.values():
        weights[tuple(columns)] += 1
    return [(weight, columns) for columns, weight in sorted(weights.items())]


def highs(classes, disks, drones, limit_s):
    import highspy
    import numpy as np

    k, n = len(classes), disks
    lp = highspy.HighsLp()
    lp.num_col_, lp.num_row_ = k + n, k + 1
    lp.sense_ = highspy.ObjSense.kMaximize
    lp.col_cost_ = np.array([float(w) for w, _ in classes] + [0.0] * n)
    lp.col_lower_, lp.col_upper_ = np.zeros(k + n), np.ones(k + n)
    lp.row_lower_ = np.full(k + 1, -highspy.kHighsInf)
    lp.row_upper_ = np.array([0.0] * k + [float(drones)])
    start, index, value = [0], [], []
    for i, (_, columns) in enumerate(classes):
        index += [i] + [k + j for j in columns]
        value += [1.0] + [-1.0] * len(columns)
        start.append(len(index))
    index += [k + j for j in range(n)]
    value += [1.0] * n
    start.append(len(index))
    lp.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
    lp.a_matrix_.start_, lp.a_matrix_.index_, lp.a_matrix_.value_ = start, index, value
    lp.integrality_ = [highspy.HighsVarType.kContinuous] * k + [highspy.HighsVarType.kInteger] * n
    solver = highspy.Highs()
    solver.setOptionValue("output_flag", False)
    solver.setOptionValue("threads", 1)
    solver.setOptionValue("time_limit", float(limit_s))
    solver.setOptionValue("mip_rel_gap", 0.0)
    solver.setOptionValue("mip_abs_gap", 0.999)  # weights are whole numbers
    solver.passModel(lp)
    begin = time.process_time()
    solver.run()
    cpu_s = time.process_time() - begin
    info = solver.getInfo()
    proved = solver.getModelStatus() == highspy.HighsModelStatus.kOptimal
    return {"value": round(info.objective_function_value), "proved": proved, "cpu_s": cpu_s}


def cp_sat(classes, disks, drones, limit_s):
    from ortools.sat.python import cp_model

    model = cp_model.CpModel()
    x = [model.new_bool_var(f"x{j}") for j in range(disks)]
    y = [model.new_bool_var(f"y{i}") for i in range(len(classes))]
    for served, (_, columns) in zip(y, classes):
        model.add(sum(x[j] for j in columns) >= served)
    model.add(sum(x) <= drones)
    model.maximize(sum(w * served for (w, _), served in zip(classes, y)))
    solver = cp_model.CpSolver()
    solver.parameters.num_workers = 1
    solver.parameters.linearization_level = 2
    solver.parameters.max_time_in_seconds = limit_s
    begin = time.process_time()
    status = solver.solve(model)
    cpu_s = time.process_time() - begin
    return {"value": round(solver.objective_value), "proved": status == cp_model.OPTIMAL, "cpu_s": cpu_s}


SOLVERS = {"highs": highs, "cp_sat": cp_sat}


def one(name, asked):
    """What one solver finds, in a process of its own: both bring a HiGHS library, and these do not bear each other."""
    command = [sys.executable, __file__, name]
    done = subprocess.run(command, input=json.dumps(asked), capture_output=True, text=True)
    return json.loads(done.stdout) if done.returncode == 0 else None


def main():
    asked = json.load(sys.stdin)
    classes, disks = classes_of(asked["disks"]), len(asked["disks"])
    if len(sys.argv) > 1:
        print(json.dumps(SOLVERS[sys.argv[1]](classes, disks, asked["drones"], asked["limit_s"])))
        return
    told = {"classes": len(classes), "disks": disks}
    found = {name: one(name, asked) for name in SOLVERS}
    told.update({name: of for name, of in found.items() if of})
    print(json.dumps(told))


if __name__ == "__main__":
    main()
