# SPDX-License-Identifier: BSD-3-Clause
"""Judges faults of actuators by its own code: actuators.py APC EXPERIMENT FOLDER

A first-order plant with exact integration tells where its actuator stood in each interval. Without a fault that is
the command; with one it must be what the equations make of these commands. The record keeps the commands.
"""
import csv
import math
import subprocess
import sys

apc, experiment, folder = sys.argv[1:]
PERIOD, TAU, GAIN, AT, UNTIL = 0.2, 0.5, 2.0, 4.0, 30.0
LOW, HIGH = -10.0, 10.0
MOVES = [1.0, 2.0, 1.2, 0.2, 0.9, 3.0, 6.0, 9.0, 8.5, 8.0, 7.0, 4.0, 3.9, 4.4, 0.0, -4.0, -9.0, -8.7, -2.0, -2.2]


def actions():
    yield '{ at = 0.5; mode = "u"; value = "Man"; }'
    for k, value in enumerate(MOVES):
        yield '{ at = %.15g; set = "u"; value = %.15g; }' % (1.1 + 2 * k, value)


def simulate(name, faults):
    settings = ['client.period=0.2', 'controller.period=0.2', 'duration=44.0', 'plant.period=0.2',
                f'plant.parameters.K={GAIN}', f'plant.parameters.tau={TAU}', 'plant.rtol=1e-12', 'plant.atol=1e-12',
                f'actions=( {", ".join(actions())} )', f'outputs.u.faults=( {faults} )']
    run = f'{folder}/{name}'
    subprocess.run([apc, 'simulate', experiment, '--report', run] + [f'--set={s}' for s in settings], check=True,
                   stdout=subprocess.DEVNULL)
    y, u = [], []
    with open(f'{run}/samples.csv', newline='') as file:
        for row in csv.DictReader(file):
            if row['table'] == 'sensor':
                y.append((float(row['time']), float(row['value'])))
            elif row['table'] == 'actuator':
                u.append((row['time'], row['value']))
    decay = math.exp(-PERIOD / TAU)
    x = []
    for (t, before), (after, now) in zip(y, y[1:]):
        assert abs(after - t - PERIOD) < 1e-6, 'a tick of the plant is missing'
        x.append((t - y[0][0], (now - decay * before) / (1 - decay) / GAIN))
    return x, u


def sticky(s, j):
    """He, Wang, Pottmann and Qin (2007), figure 4: u_r is the force that is left; fs, fd of Choudhury's S and J."""
    fs, fd = (s + j) / 2, (s - j) / 2
    left, last, v = 0.0, None, None

    def step(u, position):
        nonlocal left, last, v
        if last is None:
            last, v = position, position
        force = left + u - last
        last = u
        if abs(force) > fs:
            v = u - math.copysign(1, force) * fd
            left = math.copysign(1, force) * fd
        else:
            left = force
        return v
    return step


def play(width):
    """Backlash: the gap [x - width/2, x + width/2] is pushed along by the command."""
    return lambda u, x: max(u - width / 2, min(u + width / 2, x))


KINDS = {
    'stuck': ('', lambda u, x: x),
    'stiction': ('size = 2.0; jump = 0.5;', sticky(2.0, 0.5)),
    'overshoot': ('size = 0.8; jump = 1.2;', sticky(0.8, 1.2)),
    'backlash': ('size = 1.5;', play(1.5)),
    'rate': ('size = 0.7;', lambda u, x: x + max(-0.7 * PERIOD, min(0.7 * PERIOD, u - x))),
    'saturation': ('low = -3.0; high = 5.0;', lambda u, x: max(-3.0, min(5.0, u))),
    'reverse': ('', lambda u, x: LOW + HIGH - u),
}

told, record = simulate('without', '')
assert len({round(x, 6) for _, x in told}) > 15, 'the plant was not moved'
for name, (numbers, model) in KINDS.items():
    kind = 'stiction' if name == 'overshoot' else name
    stood, kept = simulate(name, f'{{ kind = "{kind}"; at = {AT}; duration = {UNTIL}; {numbers} }}')
    assert kept == record, f'{name}: the record does not keep the commands'
    position, differs = 0.0, 0
    for (t, command), (_, x) in zip(told, stood):
        position = model(command, position) if AT - 1e-6 <= t < AT + UNTIL - 1e-6 else command
        assert abs(x - position) < 1e-6, f'{name}: at {t:.1f} s told {command:.9g}, stands {x:.9g}, not {position:.9g}'
        differs += abs(x - command) > 1e-3
    assert differs > 20, f'{name}: nothing came of it'
