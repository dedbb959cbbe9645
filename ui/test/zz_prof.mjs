import {launch, until} from "./lib.mjs";
const browser = await launch();
const ctx = await browser.newContext({viewport: {width: 1280, height: 800}});
for (let k = 0; k < 2; k++) {
const page = await ctx.newPage();
const cdp = await ctx.newCDPSession(page);
await cdp.send("Profiler.enable"); await cdp.send("Profiler.setSamplingInterval", {interval: 500}); await cdp.send("Profiler.start");
await page.goto(process.env.M + "/#overview");
await until("rows", async () => (await page.locator("main .rows .value[data-seq]").count()) >= 20);
const {profile} = await cdp.send("Profiler.stop");
const self = new Map(), total = new Map(); const byId = new Map(profile.nodes.map(n => [n.id, n])); const parent = new Map(); for (const n of profile.nodes) for (const c of n.children ?? []) parent.set(c, n.id);
profile.samples.forEach((id, i) => { const dt = (profile.timeDeltas[i + 1] ?? 0) / 1000; const f = byId.get(id).callFrame; const name = n => n.functionName + ":" + n.lineNumber + ":" + n.columnNumber; self.set(name(f), (self.get(name(f)) ?? 0) + dt); const seen = new Set(); for (let x = id; x; x = parent.get(x)) { const nm = name(byId.get(x).callFrame); if (!seen.has(nm)) { seen.add(nm); total.set(nm, (total.get(nm) ?? 0) + dt); } } });
const top = m => [...m].sort((a, b) => b[1] - a[1]).slice(0, 28).map(([n, t]) => `${t.toFixed(0)} ${n}`).join("\n  ");
if (k) console.log("self\n  " + top(self) + "\ntotal\n  " + top(total));
await page.close();
}
await browser.close();
