// SPDX-License-Identifier: BSD-3-Clause
// walk.mjs URL USER PASSWORD FOLDER: what node-opcua, which nobody here wrote, finds at a store that apc.opcua serves: it
// browses, reads, subscribes, writes with an outcome, and acknowledges an alarm. FOLDER is for its certificates.
import assert from "node:assert/strict";
import { createRequire } from "node:module";

const {
  AttributeIds, ClientSubscription, constructEventFilter, DataType, MessageSecurityMode, OPCUACertificateManager, OPCUAClient, resolveNodeId,
  SecurityPolicy, TimestampsToReturn, UserTokenType, callConditionRefresh,
} = createRequire(`${process.env.APC_PEERS}/`)("node-opcua");

const [url, user, password, folder] = process.argv.slice(2);
const certificates = new OPCUACertificateManager({ rootFolder: folder, automaticallyAcceptUnknownCertificate: true });
await certificates.initialize();
const client = OPCUAClient.create({
  clientCertificateManager: certificates, endpointMustExist: false, connectionStrategy: { maxRetry: 3, initialDelay: 100 },
  ...(user ? { securityMode: MessageSecurityMode.SignAndEncrypt, securityPolicy: SecurityPolicy.Basic256Sha256 } : {}),
});
await client.connect(url);

if (user) {
  await assert.rejects(client.createSession({ type: UserTokenType.UserName, userName: user, password: "wrong" }),
    /BadUserAccessDenied|BadIdentityTokenRejected/);
  await assert.rejects(client.createSession(), /BadIdentityTokenRejected|BadUserAccessDenied|token/i);
}
const session = await client.createSession(user ? { type: UserTokenType.UserName, userName: user, password } : undefined);
const index = (await session.readNamespaceArray()).indexOf("urn:libapc:plant");
const id = (name) => `ns=${index};s=${name}`;
const value = async (name) => (await session.read({ nodeId: id(name), attributeId: AttributeIds.Value })).value.value;
const write = async (name, dataType, v) =>
  (await session.write({ nodeId: id(name), attributeId: AttributeIds.Value, value: { value: { dataType, value: v } } })).name;
const until = async (what, f) => {
  for (const end = Date.now() + 120_000; Date.now() < end; await new Promise((go) => setTimeout(go, 50))) if (await f()) return;
  assert.fail(`did not come true: ${what}`);
};

// browse
const names = async (name) => (await session.browse(id(name))).references.map((r) => r.browseName.name);
for (const name of ["Measurements", "Setpoints", "Outputs", "Modes", "Parameters", "Alarms", "Set", "SetMode", "Acknowledge"])
  assert.ok((await names("plant")).includes(name), name);
assert.deepEqual([await names("Measurements"), await names("Alarms")], [["y"], ["r.high"]]);

// read
const y = await session.read({ nodeId: id("sensor.y"), attributeId: AttributeIds.Value });
assert.ok(y.statusCode.isGood() && Number.isFinite(y.value.value) && y.sourceTimestamp, y.toString());
assert.equal((await session.read({ nodeId: id("setpoint.r/range"), attributeId: AttributeIds.Value })).value.value.high, 100);
assert.equal((await session.read({ nodeId: id("sensor.nobody"), attributeId: AttributeIds.Value })).statusCode.name, "BadNodeIdUnknown");

// subscribe: values come by themselves, events as well
const subscription = ClientSubscription.create(session, { requestedPublishingInterval: 100, requestedLifetimeCount: 1000,
  requestedMaxKeepAliveCount: 10, maxNotificationsPerPublish: 100, publishingEnabled: true, priority: 1 });
const came = [], events = [];
(await subscription.monitor({ nodeId: id("sensor.y"), attributeId: AttributeIds.Value },
  { samplingInterval: 100, discardOldest: true, queueSize: 100 }, TimestampsToReturn.Both)).on("changed", (v) => came.push(v.value.value));
const fields = ["EventId", "ConditionName", "Message", "Severity", "ActiveState.Id", "AckedState.Id", "Retain"];
(await subscription.monitor({ nodeId: resolveNodeId("Server"), attributeId: AttributeIds.EventNotifier,
}, { queueSize: 1000, discardOldest: true, filter: constructEventFilter([...fields]) }, TimestampsToReturn.Both))
  .on("changed", (e) => events.push(Object.fromEntries(fields.map((f, i) => [f, e[i].value]))));

// write, and what becomes of it
assert.equal(await write("setpoint.r", DataType.Double, 15), "Good");
assert.equal(await value("setpoint.r"), 15);
await until("values come", () => new Set(came).size > 3);
assert.equal(await write("setpoint.r", DataType.Double, 1e9), "BadOutOfRange");
assert.equal(await write("setpoint.r", DataType.String, "much"), "BadTypeMismatch");
assert.equal(await write("setpoint.r", DataType.Double, NaN), "BadOutOfRange");
assert.equal(await write("actuator.u", DataType.Double, 1), "BadInvalidState");
await until("why it was refused is an event", () => events.some((e) => /^u = 1: .*refused/.test(e.Message?.text)));
assert.equal(await write("sensor.y", DataType.Double, 1), "BadUserAccessDenied");
assert.equal(await write("tuning.Kp", DataType.Double, 0.25), user ? "BadUserAccessDenied" : "Good");
assert.equal(await write("opmode.u", DataType.String, "Man"), "Good");
assert.equal(await write("actuator.u", DataType.Double, 1), "Good");
const call = async (name, ...args) => {
  const r = await session.call({ objectId: id("plant"), methodId: id(name), inputArguments: args.map((value) => ({
    dataType: typeof value === "number" ? DataType.Double : DataType.String, value })) });
  return r.statusCode.isGood() ? r.outputArguments[0].value : r.statusCode.name;
};
assert.equal(await call("SetMode", "u", "Auto"), "Auto");
assert.equal(await call("SetMode", "u", "Sideways"), "BadTypeMismatch");
assert.equal(await call("Set", "r", 14.5), 14.5);
assert.equal(await call("Set", "r"), "BadInvalidArgument");
assert.equal(await call("Set", "nothing", 1), "BadNodeIdUnknown");

// the alarm that this raised: seen, acknowledged, and not twice
await until("an alarm is raised", () => events.some((e) => e.ConditionName === "r.high" && e["ActiveState.Id"]));
const raised = events.findLast((e) => e.ConditionName === "r.high");
assert.deepEqual([raised.Message.text, raised.Severity, raised["AckedState.Id"], raised.Retain], ["too much", 900, false, true]);
const before = events.length;
await callConditionRefresh(session, subscription.subscriptionId);
await until("what stands is told again", () => events.slice(before).some((e) => e.ConditionName === "r.high"));
const condition = resolveNodeId(id("alarm.r.high"));
const acknowledge = async (event, of = condition) => (await session.acknowledgeCondition(of, event, "seen by node-opcua")).name;
assert.equal(await acknowledge(Buffer.from("something")), "BadEventIdUnknown");
assert.equal(await acknowledge(raised.EventId), "Good");
await until("it is acknowledged", () => events.some((e) => e.ConditionName === "r.high" && e["AckedState.Id"]));
assert.equal(await acknowledge(events.findLast((e) => e.ConditionName === "r.high").EventId), "BadConditionBranchAlreadyAcked");
assert.equal(await value("alarm.r.high/State"), "Acknowledged Active");
assert.equal(await write("setpoint.r", DataType.Double, 10), "Good");

await subscription.terminate();
await session.close();
await client.disconnect();
console.log("walked");
process.exit(0);
