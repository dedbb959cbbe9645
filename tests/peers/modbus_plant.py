# SPDX-License-Identifier: BSD-3-Clause
"""A first-order plant, K = 10, tau = 1 s, as a PLC has it: modbus_plant.py PORT

Holding registers 0, 1: u as float32; 2: the client's watchdog. Input registers 0, 1: y as float32; 2: a count, as long as
it is alive. Without a new count of the watchdog for 1.5 s it goes to its safe value, 0. Says what it was given. SIGUSR1: somebody
turns it to local, with u = 0.25, or back.
"""

import math
import signal
import struct
import sys
import time

from pymodbus.server import StartTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice


class Plant:
    def __init__(self):
        self.at = self.fed = time.monotonic()
        self.x = self.u = 0.0
        self.watchdog = self.life = 0
        self.local = False
        signal.signal(signal.SIGUSR1, self.turn)

    def turn(self, *_):
        self.local = not self.local

    def advance(self):
        now = time.monotonic()
        if now - self.fed > 1.5 and self.u != 0.0:
            self.u = 0.0
            print("nobody is there: safe", flush=True)
        share = math.exp(self.at - now)
        self.x = self.x * share + 10.0 * self.u * (1.0 - share)
        self.at = now

    async def action(self, function, start, address, count, registers, values):
        self.advance()
        if function == 16 and values is not None:
            given = dict(enumerate(values, address))
            if 0 in given and not self.local:
                self.u = struct.unpack(">f", struct.pack(">HH", given[0], given[1]))[0]
                print(f"given {self.u:g}", flush=True)
            if 2 in given and given[2] != self.watchdog:
                self.watchdog = given[2]
                self.fed = self.at
        if self.local:
            self.u = 0.25
        if function == 3 and start == 0:
            registers[0 : 2] = struct.unpack(">HH", struct.pack(">f", self.u))
        if function == 4:
            self.life = (self.life + 1) % 65536
            registers[0 - start : 3 - start] = [*struct.unpack(">HH", struct.pack(">f", self.x)), self.life]


plant = Plant()
block = [SimData(0, count=3, values=0, datatype=DataType.REGISTERS)]
bits = [SimData(0, count=1, values=False, datatype=DataType.BITS)]
StartTcpServer(
    SimDevice(1, simdata=(bits, bits, block, block), action=plant.action), address=("127.0.0.1", int(sys.argv[1]))
)
