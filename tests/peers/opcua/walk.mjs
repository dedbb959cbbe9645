// SPDX-License-Identifier: BSD-3-Clause
// walk.mjs URL USER PASSWORD FOLDER: what node-opcua, which nobody here wrote, finds at a store that apc.opcua serves: it
// browses, reads, also what was, subscribes, writes with an outcome, acknowledges an alarm and shelves it. FOLDER is for its certificates.
import assert from "node:assert/strict";
import { createRequire } from "node:module";

const {
  AttributeIds, ClientSubscription, constructEventFilter, DataType, MessageSecurityMode, OPCUACertificateManager, OPCUAClient, resolveNodeId,
  SecurityPolicy, StatusCodes, TimestampsToReturn, UserTokenType, callConditionRefresh,
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

// what they are: a number with a range, as often as it can be new; the server, and not what it is made of
// Promise(links/opcua-types): Variables are of AnalogItemType, with range, unit code, description and sampling
//   interval; a condition has all that Part 9 wants of it; the build information is ours.
const attribute = async (name, attributeId) => (await session.read({ nodeId: id(name), attributeId })).value.value;
const kind = async (name) => (await session.browse({ nodeId: id(name), referenceTypeId: "HasTypeDefinition" })).references[0].nodeId.toString();
assert.equal(await kind("setpoint.r"), "ns=0;i=2368");
assert.equal(await attribute("setpoint.r", AttributeIds.MinimumSamplingInterval), 100);
assert.equal((await attribute("setpoint.r", AttributeIds.Description)).text, "setpoint");
const built = (await session.read({ nodeId: "ns=0;i=2260", attributeId: AttributeIds.Value })).value.value;
assert.deepEqual([built.productName, built.manufacturerName, built.productUri], ["libapc", "libapc", "urn:libapc"]);

// a condition has all that its type, and those above it, have to have
// Promise(links/opcua-types)
const children = async (nodeId) => (await session.browse({ nodeId, referenceTypeId: "Aggregates", includeSubtypes: true, browseDirection: 0 })).references;
const lacking = async (nodeId, types) => {
  const has = (await children(nodeId)).map((r) => r.browseName.name), lacks = [];
  for (const type of types)
    for (const part of await children(type)) {
      const rule = (await session.browse({ nodeId: part.nodeId, referenceTypeId: "HasModellingRule", browseDirection: 0 })).references[0];
      if (rule?.nodeId.value === 78 && !has.includes(part.browseName.name)) lacks.push(part.browseName.name);
    }
  return lacks;
};
assert.deepEqual(await lacking(id("alarm.r.high"), ["ns=0;i=2041", "ns=0;i=2782", "ns=0;i=2881", "ns=0;i=2915"]), []);
for (const name of ["EnabledState", "AckedState", "ActiveState"]) assert.deepEqual(await lacking(id(`alarm.r.high/${name}`), ["ns=0;i=8995"]), []);
assert.deepEqual(await lacking(id("alarm.r.high/ShelvingState"), ["ns=0;i=2929"]), []);

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
for (const statusCode of [StatusCodes.BadSensorFailure, StatusCodes.UncertainLastUsableValue])
  assert.equal((await session.write({ nodeId: id("setpoint.r"), attributeId: AttributeIds.Value,
    // Promise(links/opcua-waits)
    value: { statusCode, value: { dataType: DataType.Double, value: 12 } } })).name, "BadWriteNotSupported");
assert.equal(await value("setpoint.r"), 15);
assert.equal(await write("actuator.u", DataType.Double, 1), "BadInvalidState");
await until("why it was refused is an event", () => events.some((e) => /^u = 1: .*Man/.test(e.Message?.text)));
assert.equal(await write("setpoint.nobody", DataType.Double, 1), "BadNodeIdUnknown");
assert.equal(await write("sensor.y", DataType.Double, 1), "BadNotWritable");
await until("why nothing is written there is an event", () => events.some((e) => /sensor.y: there is no "y" to be set/.test(e.Message?.text)));
assert.equal(await write("tuning.Kp", DataType.Double, 0.25), user ? "BadUserAccessDenied" : "Good");
assert.equal(await write("opmode.u", DataType.String, "Man"), "Good");
assert.equal(await write("actuator.u", DataType.Double, 1), "Good");
const call = async (name, ...args) => {
  const r = await session.call({ objectId: id("plant"), methodId: id(name), inputArguments: args.map((value) => ({
    dataType: typeof value === "number" ? DataType.Double : DataType.String, value })) });
  return r.statusCode.isGood() ? r.outputArguments[0].value : r.statusCode.name;
};
assert.equal(await call("SetMode", "u", "Auto"), "Auto");
// a parameter takes its role by whatever name
assert.equal(await call("Set", "Kp", 0.25), user ? "BadUserAccessDenied" : 0.25);
assert.equal(await call("Set", "tuning.1", 0.25), user ? "BadUserAccessDenied" : 0.25);

// what waits for the controller holds up nobody else of the same connection, and keeps its order
// Promise(links/opcua-waits): What waits for the controller holds up nobody else of the connection; what is written
//   as Bad or Uncertain does not come into force; after a restart of the server who had subscribed has values again.
const answers = [];
const note = async (what, answer) => { await answer; answers.push(what); };
await Promise.all([note("write", write("setpoint.r", DataType.Double, 13)), note("call", call("Set", "r", 14)), note("read", value("sensor.y"))]);
assert.equal(answers[0], "read");
assert.ok(answers.indexOf("write") < answers.indexOf("call"));
assert.equal(await value("setpoint.r"), 14);
assert.equal(await call("SetMode", "u", "Sideways"), "BadTypeMismatch");
assert.equal(await call("Set", "r", 14.5), 14.5);
assert.equal(await call("Set", "r"), "BadInvalidArgument");
assert.equal(await call("Set", "nothing", 1), "BadNodeIdUnknown");

// the alarm that this raised: seen, acknowledged, and not twice
await until("an alarm is raised", () => events.some((e) => e.ConditionName === "r.high" && e["ActiveState.Id"]));
const raised = events.findLast((e) => e.ConditionName === "r.high");
assert.deepEqual([raised.Message.text, raised.Severity, raised["AckedState.Id"], raised.Retain], ["too much", 900, false, true]);
const told = events.length;
await callConditionRefresh(session, subscription.subscriptionId);
await until("what stands is told again", () => events.slice(told).some((e) => e.ConditionName === "r.high"));
const condition = resolveNodeId(id("alarm.r.high"));
const acknowledge = async (event, of = condition) => (await session.acknowledgeCondition(of, event, "seen by node-opcua")).name;
assert.equal(await acknowledge(Buffer.from("something")), "BadEventIdUnknown");
assert.equal(await acknowledge(raised.EventId), "Good");
await until("it is acknowledged", () => events.some((e) => e.ConditionName === "r.high" && e["AckedState.Id"]));
assert.equal(await acknowledge(events.findLast((e) => e.ConditionName === "r.high").EventId), "BadConditionBranchAlreadyAcked");
assert.equal(await value("alarm.r.high/State"), "Acknowledged Active");
assert.equal(await write("setpoint.r", DataType.Double, 10), "Good");


// and shelved, until a time or until it has come and gone, and no more
const shelving = id("alarm.r.high/ShelvingState");
const shelve = async (method, ...ms) => (await session.call({ objectId: shelving, methodId: resolveNodeId(`ns=0;i=${method}`),
  inputArguments: ms.map((value) => ({ dataType: DataType.Double, value })) })).statusCode.name;
const [UNSHELVE, ONE_SHOT, TIMED] = [2947, 2948, 2949];
const is = (state) => until(`it is ${state}`, async () => (await value("alarm.r.high/ShelvingState/CurrentState")).text === state);
assert.equal(await shelve(UNSHELVE), "BadConditionNotShelved");
assert.equal(await shelve(TIMED, 1e12), "BadShelvingTimeOutOfRange");
assert.equal(await shelve(TIMED, -1), "BadShelvingTimeOutOfRange");
assert.equal(await shelve(TIMED), "BadInvalidArgument");
assert.equal(await shelve(TIMED, 600_000), "Good");
await is("TimedShelved");
assert.ok(await value("alarm.r.high/ShelvingState/UnshelveTime") > 0);
assert.equal((await value("alarm.r.high/ShelvingState/CurrentState/Id")).value, 2932);
assert.equal(await shelve(TIMED, 600_000), "BadConditionAlreadyShelved");
assert.equal(await shelve(UNSHELVE), "Good");
await is("Unshelved");
assert.equal(await shelve(ONE_SHOT), "Good");
await is("OneShotShelved");
assert.equal(await shelve(UNSHELVE), "Good");
await is("Unshelved");

// what was: all of it in pages, the newest first, one of them, none
const past = async (what, start, end, options = {}) => session.readHistoryValue(typeof what === "string" ? id(what) : what, start, end, options);
const when = (r) => r.historyData.dataValues.map((v) => v.sourceTimestamp.getTime());
const from = new Date(Date.now() - 86_400_000);
const latest = (await past("sensor.y", from, new Date())).historyData.dataValues.at(-1).sourceTimestamp.getTime();
const to = new Date(latest + 1); // what came by then; of a moment ago there may be more to come
const all = await past("sensor.y", from, to);
assert.ok(all.statusCode.isGood() && when(all).length > 5, all.toString());
assert.ok(when(all).every((t, i) => i === 0 || t > when(all)[i - 1]) && all.historyData.dataValues.every((v) => Number.isFinite(v.value.value)));
const paged = [];
for (let point, first = true; first || point; first = false) {
  const page = await past({ nodeId: id("sensor.y"), continuationPoint: point }, from, to, { numValuesPerNode: 3 });
  assert.ok(when(page).length <= 3);
  paged.push(...when(page));
  point = page.continuationPoint?.length ? page.continuationPoint : undefined;
}
assert.deepEqual(paged, when(all));
const newest = await past("sensor.y", to, from, { numValuesPerNode: 2 });
assert.deepEqual(when(newest), when(all).slice(-2).reverse());
const before = await past({ nodeId: id("sensor.y"), continuationPoint: newest.continuationPoint }, to, from, { numValuesPerNode: 2 });
assert.deepEqual(when(before), when(all).slice(-4, -2).reverse());
assert.equal((await past("sensor.y", new Date(0), new Date(1000))).statusCode.name, "BadHistoryOperationInvalid");
assert.equal((await past("sensor.y", new Date("2001-01-01"), new Date("2001-01-02"))).statusCode.name, "GoodNoData");
assert.equal((await past({ nodeId: id("sensor.y"), continuationPoint: Buffer.from("x") }, from, to)).statusCode.name, "BadContinuationPointInvalid");
assert.equal((await past("alarm.r.high/State", from, to)).statusCode.name, "BadHistoryOperationUnsupported");
assert.equal((await past("sensor.nobody", from, to)).statusCode.name, "BadHistoryOperationUnsupported");

await subscription.terminate();
await session.close();
await client.disconnect();
console.log("walked");
process.exit(0);
