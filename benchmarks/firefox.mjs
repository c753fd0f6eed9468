/* The playground in Firefox: its figures are those in Chromium, which tests compare with this program's.

    flexible-manipulator playground --help          how the page is written to a file
    npm install puppeteer-core
    node benchmarks/firefox.mjs playground.html [/usr/bin/firefox-esr] [/usr/bin/chromium]

Playwright, which the tests use, drives a Firefox of its own alone; this takes the system's. Writes firefox.png and
firefox-phone.png. Exit codes: 0 all equal, 1 something differs or a page complained.
*/
import path from "node:path";
import puppeteer from "puppeteer-core";

const [file, firefox = "/usr/bin/firefox-esr", chromium = "/usr/bin/chromium"] = process.argv.slice(2);
const LEAD = {
  A: [[0.9, 0.01, 0.0], [0.0, 0.93, 0.0], [0.0, 0.1, 0.5]],
  B: [[1.0, 0.0], [0.0, 1.0], [0.3, 0.0]],
  C: [[-150.0, 0.0, 1.0], [0.0, -35.0, 2.0]],
  D: [[1545.0, 0.0], [0.0, 515.0]],
};
const ARM = { "m[1]": 46.25, "k_low[2]": 173000.0, "psi[1]": 0.00047, "f_c[2]": 1.7, "gamma[1]": 1.09 };
const STATES = {
  "as it begins": {},
  "gains, force and its direction": { chosen: { name: "TunedPID", values: { "K_p[1]": 31.5 } }, force: 340, phi: 1.25 },
  "a loop that is worse": { protocolCase: "c11.sticky.gain_2", gain: [1.7, 0.6], delay: [0.00075, 0.00175] },
  "an arm of one's own": {
    protocolCase: "c03.random_2.disturbance", pose: [12.3, -45.6], arm: ARM, seed: 5000000017, chosen: { name: "RobustLQG", values: {} },
  },
  matrices: { chosen: { name: "linear", matrices: LEAD }, protocolCase: "c05.compliant.noise" },
};

/** What the page answers in each state, and its scorecards. */
async function answers(browser, executablePath) {
  const driver = await puppeteer.launch({ browser, executablePath, args: browser === "chrome" ? ["--no-sandbox"] : [] });
  const page = await driver.newPage();
  const troubles = [];
  page.on("pageerror", (error) => troubles.push(String(error)));
  page.on("console", (said) => ["error", "warn"].includes(said.type()) && troubles.push(said.text()));
  await page.setViewport({ width: 1400, height: 900 });
  await page.goto(`file://${path.resolve(file)}`);
  const finished = () => page.waitForSelector('#results[aria-busy="false"]', { timeout: 60_000 });
  await finished();
  const found = {};
  for (const [name, state] of Object.entries(STATES)) {
    await page.evaluate(`$("#results").setAttribute("aria-busy", "true"); location.hash = encoded(${JSON.stringify(state)})`);
    await finished();
    found[name] = await page.evaluate("JSON.stringify(data.answers)");
  }
  for (const protocol of ["quick", "paper"]) {
    await page.evaluate('$("#scorecard").replaceChildren()');
    await page.click(`[data-protocol="${protocol}"]`);
    await page.waitForSelector("#scorecard .hero", { timeout: 600_000 });
    found[protocol] = await page.evaluate("JSON.stringify(data.scorecard)");
  }
  await page.screenshot({ path: `${browser}.png` });
  await page.setViewport({ width: 390, height: 844 });
  if (await page.evaluate("document.documentElement.scrollWidth > innerWidth")) troubles.push("wider than a phone");
  await page.screenshot({ path: `${browser}-phone.png` });
  console.log(await driver.version(), troubles);
  await driver.close();
  return [found, troubles];
}

const [wanted] = await answers("chrome", chromium);
const [found, troubles] = await answers("firefox", firefox);
const other = Object.keys(wanted).filter((name) => wanted[name] !== found[name]);
console.log(`${Object.keys(wanted).length} states and protocols, different: ${other.join(", ") || "none"}`);
process.exitCode = other.length || troubles.length ? 1 : 0;
