# SPDX-License-Identifier: BSD-3-Clause
"""What each front end says of a bad write, and what becomes of a good one: bad_writes.txt, write_outcomes.txt.

    bad_writes.py TABLE cli APC STORE | http PORT ENGINEER OBSERVER | mqtt PORT HEARD | request | python URI |
                  opcua URL PASSWORD

ENGINEER and OBSERVER are tokens; HEARD is the log of a mosquitto_sub of all outcomes; PASSWORD is that of anna and of
otto. Prints how many were asked.
"""
import contextlib
import functools
import json
import subprocess
import sys
import time
import urllib.error
import urllib.request
from typing import NamedTuple

RAMPS = ("ramp", "stop")  # by apc, the page and Python alone
MODES = ("Man", "Auto", "OOS", "Cas")


def until(what, true):
    """What becomes true, within a minute that a busy machine may take for it."""
    end = time.monotonic() + 60
    while not (said := true()):
        if time.monotonic() > end:
            sys.exit(f"it did not come true within 60 s: {what}")
        time.sleep(0.05)
    return said


def fetched(request):
    with urllib.request.urlopen(request, timeout=60) as answer:
        return answer.read().decode()


class Row(NamedTuple):
    who: str
    what: str
    name: str
    id: str
    value: str
    reason: str
    exit: str
    http: str
    exception: str
    status: str
    sentence: str

    def number(self):
        """The value, as JSON has it."""
        try:
            return float(self.value)
        except ValueError:
            return self.value

    def outcome(self):
        """Is it a good write? Then its controller does from now on what the row says."""
        if self.who in ("anna", "otto", "late"):
            return False
        sql("UPDATE public.habit SET is_now = 'takes'")
        before = sql("SELECT max(seq) FROM apc.tick")
        until("the controller has taken the newest setpoint", lambda: sql(
            f"SELECT max(seq) > {before} AND (SELECT coalesce(max(seq), 0) FROM apc.setpoint WHERE id = 1) = (SELECT seq FROM public.seen) FROM apc.tick") == "t")
        sql(f"UPDATE public.habit SET is_now = '{self.who}'")
        if self.who == "gone":
            until("the controller ticks no more", lambda: sql("SELECT max(time) < now() - interval '4 s' FROM apc.tick") == "t")
        return True

    def because(self):
        return {"reason": 81 * "x"} if self.reason == "long" else {}


def say(row, front, said, expected=""):
    if row.sentence not in said or expected not in said:
        sys.exit(f"{front}: {row.what} {row.name} {row.value}: {said!r} instead of {expected!r} {row.sentence!r}")


def cli(row, apc, store):
    if row.exit == "-":
        return False
    row.outcome()
    what = {"tune": ["tune", f"{row.name}={row.value}"], "mode": ["mode", row.name, row.value], "stop": ["set", "--stop", row.name],
            "ramp": ["set", "--over", "60", row.name, row.value]}.get(row.what, ["set", row.name, row.value])
    because = [f"--{name}={text}" for name, text in row.because().items()]
    done = subprocess.run([apc, *what, *because, "--store", store], capture_output=True, text=True)
    say(row, "apc", f"{done.stdout}{done.stderr} exit code {done.returncode}", f"exit code {row.exit}")
    return True


def http(row, port, engineer, observer, seq=0):
    if row.http == "-":
        return False
    awaited = row.outcome()
    body = {"id": int(row.id), "seq": 123456 if row.who == "late" else seq}
    if awaited:
        body["seq"] = int(sql("SELECT coalesce(max(seq), 0) FROM apc.setpoint WHERE id = 1"))
    if row.what == "stop":
        body = {"id": int(row.id), "stop": True}
    else:
        body |= {"mode": row.value} if row.what == "mode" else {"value": row.number()}
    body |= {"over": 60} if row.what == "ramp" else {}
    body = {"values": [body]} if row.what == "tune" else body
    path = {"set": "setpoint", "ramp": "setpoint", "stop": "setpoint", "tune": "tuning"}.get(row.what, row.what)
    token = observer if row.who == "otto" else engineer
    request = urllib.request.Request(f"http://127.0.0.1:{port}/api/{path}", json.dumps(body | row.because()).encode(),
                                     {"Content-Type": "application/json", "Authorization": f"Bearer {token}"})
    try:
        said = fetched(request)
        if awaited and '"state":"accepted"' in said:
            key = json.loads(said).get("key") or json.loads(said)["writes"][0]["key"]
            again = urllib.request.Request(f"http://127.0.0.1:{port}/api/writes?key={key}", headers={"Authorization": f"Bearer {token}"})
            said = until("the page knows what became of a write", lambda: '"state":"accepted"' not in (now := fetched(again)) and now)
    except urllib.error.HTTPError as e:
        error = json.load(e)["error"]
        if row.http in ("409 confirm", "409 second") and error["code"] == "stale":
            return http(row, port, engineer, observer, error["current"]["setpoint.1"][0])
        said = f"{e.code} {error['code']}: {error['message']}"
    say(row, "page", said, row.http)
    return True


def mqtt(row, port, heard):
    if row.what in ("tune", *RAMPS) or row.who == "late" or row.value == "nan":
        return False
    awaited = row.outcome()
    mode = row.what == "mode"
    signal = row.name + (".mode" if mode else "")
    body = {"time": time.time(), **({"mode": row.value} if mode else {"value": row.number()}), **row.because()}
    before = len(open(heard).readlines())
    subprocess.run(["mosquitto_pub", "-p", port, "-q", "1", "-t", f"works/fast/command/{'anna' if awaited else row.who}/{signal}", "-m", json.dumps(body)], check=True)
    lines = until("the broker has an outcome", lambda: len(now := open(heard).readlines()) > before and now[-1].endswith("\n") and now)
    say(row, "broker", json.loads(lines[-1].split(" ", 1)[1])["outcome"], "" if awaited else "refused: ")
    return True


def sql(query):
    return subprocess.run(["psql", "-XAtqc", query], capture_output=True, text=True, check=True).stdout.strip()


def request(row):
    value = str(MODES.index(row.value)) if row.value in MODES else row.value
    if row.what in RAMPS or row.id == "-" or row.who != "anna" or row.value == "nan" or not isinstance(row._replace(value=value).number(), float):
        return False
    table = {"set": "setpoint", "output": "manual", "mode": "opmode", "tune": "tuning"}[row.what]
    reason = row.because().get("reason", "")
    id = sql("INSERT INTO apc.request (table_name, variable, value, time, until, reason) VALUES "
             f"('{table}', {row.id}, '{value}', now(), now() + interval '60 s', '{reason}') RETURNING id")
    said = until("a request has an outcome", lambda: sql(f"SELECT outcome FROM apc.request WHERE id = {id}"))
    say(row, "request", said, "refused: ")
    return True


def python(row, uri):
    import libapc

    if row.exception == "-":
        return False
    row.outcome()
    with libapc.Store(uri) as s:
        try:
            if row.what == "mode":
                s.mode(row.name, row.value)
            elif row.what == "stop":
                s.stop(row.name)
            else:
                s.write(row.name, row.value, over=60 if row.what == "ramp" else None)
            said = "nothing"
        except libapc.Error as e:
            said = f"{type(e).__name__}: {e}"
    say(row, "Python", said, row.exception)
    return True


@functools.lru_cache(None)
def session(url, user, password):
    """A client, and the texts of the events that come to it."""
    from asyncua.sync import Client

    class Heard(list):
        def event_notification(self, event):
            self.append(event.Message.Text)

    client, heard = Client(url, timeout=60), Heard()
    client.set_user(user)
    client.set_password(password)
    client.connect()
    sessions.callback(client.disconnect)
    client.create_subscription(50, heard).subscribe_events()
    return client, heard


def opcua(row, url, password):
    from asyncua import ua

    if row.status == "-":
        return False
    client, heard = session(url, "otto" if row.who == "otto" else "anna", password)
    index = client.get_namespace_index("urn:libapc:plant")

    def node(name):
        return client.get_node(f"ns={index};s={name}")

    table = {"set": "setpoint", "output": "actuator", "mode": "opmode", "tune": "tuning"}[row.what]
    kind = ua.VariantType.Double if isinstance(row.number(), float) else ua.VariantType.String
    ways = [("node", lambda: node(f"{table}.{row.name}").write_value(ua.Variant(row.number(), kind)))]
    if not row.outcome():
        method = "SetMode" if row.what == "mode" else "Set"
        ways.append(("method", lambda: node("plant").call_method(node(method), row.name, ua.Variant(row.number(), kind))))
    for way, write in ways:
        before = len(heard)
        try:
            write()
            said = "Good: applied"
        except ua.UaStatusCodeError as e:
            until("the server says why", lambda: len(heard) > before)
            said = f"{ua.StatusCode(e.code).name}: {heard[-1]}"
        say(row, f"OPC UA by its {way}", said, f"{row.status}: ")
    return True


rows = [Row(*line.rstrip("\n").split("|")) for line in open(sys.argv[1]) if not line.startswith("#")]
ask = {"cli": cli, "http": http, "mqtt": mqtt, "request": request, "python": python, "opcua": opcua}[sys.argv[2]]
with contextlib.ExitStack() as sessions:
    print(sum(ask(row, *sys.argv[3:]) for row in rows))
