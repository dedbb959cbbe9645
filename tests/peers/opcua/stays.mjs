// SPDX-License-Identifier: BSD-3-Clause
// stays.mjs URL FOLDER: node-opcua, which nobody here wrote, subscribes to y and goes on, also where the server goes away and comes
// back. It prints each value that comes. FOLDER is for its certificates.
import { createRequire } from "node:module";

const { AttributeIds, ClientSubscription, OPCUACertificateManager, OPCUAClient, TimestampsToReturn } =
  createRequire(`${process.env.APC_PEERS}/`)("node-opcua");

const [url, folder] = process.argv.slice(2);
const certificates = new OPCUACertificateManager({ rootFolder: folder, automaticallyAcceptUnknownCertificate: true });
await certificates.initialize();
const client = OPCUAClient.create({ clientCertificateManager: certificates, endpointMustExist: false, keepSessionAlive: true,
  connectionStrategy: { maxRetry: -1, initialDelay: 100, maxDelay: 500 } });
await client.connect(url);
const session = await client.createSession();
const index = (await session.readNamespaceArray()).indexOf("urn:libapc:plant");
const subscription = ClientSubscription.create(session, { requestedPublishingInterval: 100, requestedLifetimeCount: 1000,
  requestedMaxKeepAliveCount: 10, maxNotificationsPerPublish: 100, publishingEnabled: true, priority: 1 });
(await subscription.monitor({ nodeId: `ns=${index};s=sensor.y`, attributeId: AttributeIds.Value },
  { samplingInterval: 100, discardOldest: true, queueSize: 100 }, TimestampsToReturn.Both)).on("changed", (v) => console.log(`y ${v.value.value}`));
process.on("SIGTERM", () => process.exit(0));
