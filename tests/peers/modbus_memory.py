# SPDX-License-Identifier: BSD-3-Clause
"""pymodbus's server over a memory of coils and holding registers: modbus_memory.py PORT"""

import sys

from pymodbus.server import StartTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

registers = [SimData(0, count=100, values=0, datatype=DataType.REGISTERS)]
bits = [SimData(0, count=100, values=False, datatype=DataType.BITS)]
StartTcpServer(SimDevice(1, simdata=(bits, bits, registers, registers)), address=("127.0.0.1", int(sys.argv[1])))
