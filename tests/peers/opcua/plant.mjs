// SPDX-License-Identifier: BSD-3-Clause
// plant.mjs PORT FOLDER: a first-order plant behind an OPC UA server that nobody here wrote. It prints what u it is given.
// FOLDER is for its certificates.
import { createRequire } from "node:module";

const { DataType, OPCUACertificateManager, OPCUAServer, StatusCode, StatusCodes, Variant } = createRequire(`${process.env.APC_PEERS}/`)("node-opcua");

const [port, folder] = process.argv.slice(2);
const certificates = new OPCUACertificateManager({ rootFolder: folder, automaticallyAcceptUnknownCertificate: true });
// as small PLCs have it: no more than so many nodes in one request
const operationLimits = { maxNodesPerRead: 3, maxNodesPerWrite: 1 };
const server = new OPCUAServer({ port: Number(port), hostname: "127.0.0.1", serverCertificateManager: certificates,
  serverCapabilities: { operationLimits } });
await server.initialize();
const space = server.engine.addressSpace.getOwnNamespace();
const plant = space.addObject({ organizedBy: server.engine.addressSpace.rootFolder.objects, browseName: "Plant" });
let u = 0, y = 0;
const period = 0.02;
const level = space.addVariable({ componentOf: plant, browseName: "y", nodeId: "s=y", dataType: "Double" });
space.addVariable({ componentOf: plant, browseName: "u", nodeId: "s=u", dataType: "Float", value: {
  get: () => new Variant({ dataType: DataType.Float, value: u }),
  set: (variant) => {
    if (Math.abs(variant.value) > 100) return StatusCodes.BadOutOfRange;
    if (variant.value !== u) console.log(`given ${variant.value}`);
    u = variant.value;
    return StatusCodes.Good;
  } } });
let word = 0;
space.addVariable({ componentOf: plant, browseName: "word", nodeId: "s=word", dataType: "UInt16", value: {
  get: () => new Variant({ dataType: DataType.UInt16, value: word }),
  set: (variant) => {
    console.log(`word given ${variant.value}`);
    word = variant.value;
    return StatusCodes.Good;
  } } });
// what a plant's client may meet: a value that has been at rest for an hour, and its source time with it, a sensor that has failed, and what is no number
const failed = space.addVariable({ componentOf: plant, browseName: "failed", nodeId: "s=failed", dataType: "Double" });
failed.setValueFromSource({ dataType: DataType.Double, value: 7 }, StatusCodes.BadSensorFailure);
space.addVariable({ componentOf: plant, browseName: "rest", nodeId: "s=rest", dataType: "Double" })
  .setValueFromSource({ dataType: DataType.Double, value: 3.5 }, StatusCodes.Good, new Date(Date.now() - 3600_000));
// a good value that says more of itself: a queue that has overflowed
space.addVariable({ componentOf: plant, browseName: "full", nodeId: "s=full", dataType: "Double" })
  .setValueFromSource({ dataType: DataType.Double, value: 2.5 }, StatusCode.makeStatusCode(StatusCodes.Good, "InfoTypeDataValue | Overflow"));
space.addVariable({ componentOf: plant, browseName: "text", nodeId: "s=text", dataType: "String" })
  .setValueFromSource({ dataType: DataType.String, value: "much" });
setInterval(() => {
  y += period * (10 * u - y);
  level.setValueFromSource({ dataType: DataType.Double, value: y });
}, 1000 * period);
await server.start();
console.log("listens");
process.on("SIGTERM", () => process.exit(0));
