# SPDX-License-Identifier: BSD-3-Clause
"""A user of the temperature control lab, with its own package: lab_user.py PORT

Nothing of the package is changed but the search for a port, which knows of USB only.
"""

import sys
import time

import tclab
import tclab.tclab

tclab.tclab.find_arduino = lambda port="": (sys.argv[1], "a board of ours")
with tclab.TCLab() as lab:
    assert "TCLab Firmware" in lab.version, lab.version
    cold = lab.T1, lab.T2
    assert lab.Q1(100) == 100.0 and lab.Q1() == 100.0
    assert lab.Q2(150) == 100.0 and lab.Q2() == 100.0
    assert lab.LED(50) == 50.0
    for _ in range(600):
        warm = lab.T1, lab.T2
        if warm[0] > cold[0] + 0.6 and warm[1] > cold[1] + 0.3:
            break
        time.sleep(0.1)
    else:
        sys.exit(f"it does not get warmer: {cold}, {warm}")
    assert len(lab.scan()) == 4
print("warm", flush=True)
