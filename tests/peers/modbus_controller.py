# SPDX-License-Identifier: BSD-3-Clause
"""Somebody else's controller of a first-order plant behind Modbus TCP: modbus_controller.py PORT

Writes u to holding:0 and reads y from input:0, both float32, ten times a second, under PI control to y = 10. Then tries what
must not go: a u beyond the limits, a half of it, and, from an older connection, to go on while another commands.
"""

import struct
import sys
import time

from pymodbus.client import ModbusTcpClient


def words(value):
    return list(struct.unpack(">HH", struct.pack(">f", value)))


def number(reply):
    return struct.unpack(">f", struct.pack(">HH", *reply.registers))[0]


def connect():
    client = ModbusTcpClient("127.0.0.1", port=int(sys.argv[1]))
    assert client.connect()
    return client


client = connect()
integral, near = 0.0, 0
for _ in range(600):
    y = number(client.read_input_registers(0, count=2, device_id=1))
    near = near + 1 if abs(y - 10.0) < 0.05 else 0
    if near == 20:
        break
    e = 10.0 - y
    integral += 0.02 * e
    assert not client.write_registers(0, words(min(max(0.1 * e + integral, -10.0), 10.0)), device_id=1).isError()
    time.sleep(0.1)
assert near == 20, f"y is {y}"
print("settled", flush=True)

before = number(client.read_holding_registers(0, count=2, device_id=1))
assert client.write_registers(0, words(10.5), device_id=1).exception_code == 3
assert client.write_register(0, 0, device_id=1).exception_code == 3
assert client.read_input_registers(2, count=1, device_id=1).exception_code == 2
assert number(client.read_holding_registers(0, count=2, device_id=1)) == before
other = connect()
assert not other.write_registers(0, words(before), device_id=1).isError()
assert client.write_registers(0, words(before), device_id=1).exception_code == 6
assert not client.read_input_registers(0, count=2, device_id=1).isError()
client.close()

while abs(number(other.read_input_registers(0, count=2, device_id=1))) > 1.0:
    time.sleep(0.1)
print("safe", flush=True)
