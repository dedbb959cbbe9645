// SPDX-License-Identifier: BSD-3-Clause
// What the benchmarks of the page measure with: percentiles, and what of a trace is the page's own script.
export const pause = ms => new Promise(resolve => setTimeout(resolve, ms));
const sorted = values => values.slice().sort((a, b) => a - b);
export const part = (values, p) => sorted(values)[Math.min(values.length - 1, Math.floor(p * values.length))] ?? NaN;
export const ms = value => value.toFixed(value < 10 ? 1 : 0);
export const told = values => `p50 ${ms(part(values, 0.5))} ms, p95 ${ms(part(values, 0.95))} ms, max ${ms(part(values, 1))} ms, n = ${values.length}`;

const TASK = new Set(["RunTask", "ThreadControllerImpl::RunTask"]);
const SCRIPT = new Set(["FunctionCall", "EvaluateScript", "TimerFire", "FireAnimationFrame", "EventDispatch", "RunMicrotasks", "v8.run"]);

/** Of a trace: how long each outermost piece of one of these kinds kept the thread of the page, ms of its CPU. */
function pieces(traceEvents, kinds) {
  const threads = new Map();
  for (const one of traceEvents) if (one.ph === "X" && SCRIPT.has(one.name)) threads.set(`${one.pid}.${one.tid}`, (threads.get(`${one.pid}.${one.tid}`) ?? 0) + 1);
  const [main] = [...threads].sort((a, b) => b[1] - a[1])[0] ?? [];
  const out = [];
  let end = 0;
  for (const one of traceEvents.filter(each => each.ph === "X" && kinds.has(each.name) && `${each.pid}.${each.tid}` === main).sort((a, b) => a.ts - b.ts || b.dur - a.dur)) {
    if (one.ts < end) continue;
    end = one.ts + one.dur;
    out.push((one.tdur ?? one.dur) / 1000);
  }
  return out;
}

export async function profile(browser, page, what, work) {
  await browser.startTracing(page, {categories: ["devtools.timeline", "disabled-by-default-devtools.timeline", "toplevel", "v8"]});
  const began = performance.now();
  await work();
  const took = performance.now() - began;
  const {traceEvents} = JSON.parse((await browser.stopTracing()).toString());
  const lengths = pieces(traceEvents, SCRIPT);
  const tasks = pieces(traceEvents, TASK);
  console.log(`script of the page, ${what}: ${lengths.filter(one => one > 8).length} pieces above 8 ms; ${told(lengths)}`);
  console.log(`main thread, ${what}: ${((100 * tasks.reduce((sum, one) => sum + one, 0)) / took).toFixed(1)} % of its time; tasks: ${told(tasks.filter(one => one > 0.5))}`);
}
