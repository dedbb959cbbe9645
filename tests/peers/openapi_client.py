# SPDX-License-Identifier: BSD-3-Clause
"""openapi_client.py FOLDER URL TOKEN: the client that was made of docs/openapi.json, in FOLDER, reads each answer of a server."""
import importlib
import inspect
import pkgutil
import sys
import time

sys.path.insert(0, sys.argv[1])
api = importlib.import_module("apc_ui_client.api.default")
client = importlib.import_module("apc_ui_client").AuthenticatedClient(base_url=sys.argv[2], token=sys.argv[3])
GIVEN = {"var": "sensor.1", "since": -60, "bins": 5, "task": "controller", "quantity": "jitter", "output": "u", "alarm": "y.high", "at": -1,
         "inputs": "u", "outputs": "y", "loop": 1, "gain": 10.0, "tau1": 1.0, "names": "y,u"}
OPTIONAL = (("history", "var"), ("history", "bins"), ("preview", "tau1"))

asked = 0
for module in pkgutil.iter_modules(api.__path__):
    operation = importlib.import_module(f"apc_ui_client.api.default.{module.name}")
    if operation._get_kwargs.__code__.co_argcount or "body" in inspect.signature(operation._get_kwargs).parameters or module.name in ("stream", "shadow"):  # the latter needs a plant of two controllers
        continue
    wanted = {}
    for name, parameter in inspect.signature(operation.sync_detailed).parameters.items():
        if name in GIVEN and (parameter.default is inspect.Parameter.empty or (module.name, name) in OPTIONAL):
            value = GIVEN[name]
            if name == "quantity":
                value = importlib.import_module("apc_ui_client.models.quantity").Quantity(value)
            wanted[name] = value
    deadline = time.monotonic() + 60
    while (answer := operation.sync_detailed(client=client, **wanted)).status_code == 422 and module.name == "model" and time.monotonic() < deadline:
        time.sleep(0.5)  # until there is enough of a record
    if answer.status_code != 200:
        sys.exit(f"{module.name}: {answer.status_code} {answer.content[:300]!r}")
    if answer.headers["content-type"].startswith("application/json"):
        if answer.parsed is None:
            sys.exit(f"{module.name}: the client made nothing of {answer.content[:300]!r}")
        asked += 1
print(f"{asked} answers were read")
sys.exit(asked < 15)
