# SPDX-License-Identifier: BSD-3-Clause
"""OPC UA: a store as a server, and a server as a plant (docs/opcua.md). `python -m libapc.opcua --help`.

It takes asyncua: `pip install 'libapc[opcua]'`.
"""
