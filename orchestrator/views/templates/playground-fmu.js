// The FMU of the chosen law, as an archive of C sources: those of the benchmark's FMU, with other start values or matrices.

const CRC_TABLE = Array.from({ length: 256 }, (_, byte) => {
  let crc = byte;
  for (let bit = 0; bit < 8; bit += 1) crc = crc & 1 ? (crc >>> 1) ^ 0xedb88320 : crc >>> 1;
  return word(crc);
});

/** The CRC-32 of bytes; another `begin` gives another number. */
const checksum = (bytes, begin = 0) => word(~bytes.reduce((crc, byte) => CRC_TABLE[(crc ^ byte) & 255] ^ (crc >>> 8), ~begin));

const bytesOf = (text) => new TextEncoder().encode(text);

/** Numbers as bytes, the lowest one first, each with its size. */
const fields = (...numbers) => Uint8Array.from(numbers.flatMap(([size, value]) => Array.from({ length: size }, (_, place) => (value >>> (8 * place)) & 255)));

/** A zip archive of files, names to texts, without compression. */
function zipped(files) {
  const [entries, directory] = [[], []];
  let [offset, length] = [0, 0];
  for (const [path, text] of Object.entries(files)) {
    const [name, bytes] = [bytesOf(path), bytesOf(text)];
    // Version 2.0, names in UTF-8, stored, of 1 January 1980.
    const about = [[2, 20], [2, 0x800], [2, 0], [2, 0], [2, 0x21], [4, checksum(bytes)], [4, bytes.length], [4, bytes.length], [2, name.length], [2, 0]];
    entries.push(fields([4, 0x04034b50], ...about), name, bytes);
    directory.push(fields([4, 0x02014b50], [2, 0x314], ...about, [2, 0], [2, 0], [2, 0], [4, 0o100644 << 16], [4, offset]), name);
    offset += 30 + name.length + bytes.length;
    length += 46 + name.length;
  }
  const count = Object.keys(files).length;
  return new Blob([...entries, ...directory, fields([4, 0x06054b50], [2, 0], [2, 0], [2, count], [2, count], [4, length], [4, offset], [2, 0])]);
}

const MODEL = "sources/model.c", DESCRIPTION = "modelDescription.xml", GAINS = "sources/gains.h";

/** A number as C has it: without a point or an exponent, one of 1e20 would be an integer, which is too large for one. */
const double = (value) => (/[.e]/.test(String(value)) ? String(value) : `${Object.is(value, -0) ? "-0" : value}.0`);

/** With other start values: those of the description, and of the model, whose variables stand at their value references. */
function withStarts(files, values, references) {
  if (!Object.keys(values).length) return files;
  const description = new DOMParser().parseFromString(files[DESCRIPTION], "application/xml");
  for (const variable of description.querySelectorAll("ScalarVariable")) {
    const value = values[variable.getAttribute("name")];
    if (value !== undefined) variable.querySelector("Real").setAttribute("start", value);
  }
  const lines = Object.entries(values).map(([name, value]) => `    ((double *)model)[${references[name]}] = ${double(value)}; /* ${name} */`);
  const model = ["#define model_start usual_start", files[MODEL], "#undef model_start", "", "/* The start values that were chosen in the playground. */", "void model_start(void *model)", "{", "    usual_start(model);", ...lines, "}", ""];
  return { ...files, [DESCRIPTION]: new XMLSerializer().serializeToString(description), [MODEL]: model.join("\n") };
}

/** With other matrices, by columns as the build writes them. */
function withMatrices(files, { A, B, C, D }) {
  const rows = [...A.map((row, place) => [...row, ...B[place]]), ...C.map((row, place) => [...row, ...D[place]])];
  const braced = (value) => (Array.isArray(value) ? `{${value.map(braced).join(", ")}}` : double(value));
  const columns = rows.map((_, column) => rows.map((row) => row[column]));
  const gains = files[GAINS]
    .replace(/ROWS = \d+/, `ROWS = ${rows.length}`)
    .replace(/(LAW\[POINTS\]\[ROWS\]\[ROWS\] = )[^;]*;/, `$1${braced([columns])};`)
    .replace(/(BACK\[POINTS\]\[2\]\[ROWS\] = )[^;]*;/, `$1${braced([[0, 1].map(() => rows.map(() => 0))])};`);
  return { ...files, [GAINS]: gains };
}

/** The files of a built FMU, texts by path. */
async function filesOf(unit) {
  const stream = new Blob([base64Bytes(data.files)]).stream().pipeThrough(new DecompressionStream("deflate"));
  const { units: listed, texts } = await new Response(stream).json();
  return Object.fromEntries(Object.entries(listed[unit]).map(([path, number]) => [path, texts[number]]));
}

/** The archive of a law; its GUID follows from its contents. */
async function fmuOf({ name, values, matrices }) {
  const known = data.controllers.find((one) => one.name === name);
  const unit = matrices ? "Linear" : known.unit;
  const files = await filesOf(unit);
  const made = matrices ? withMatrices(files, matrices) : withStarts(files, { ...known.values, ...values }, units[unitNumber(unit)].references);
  const [, before] = /guid="([^"]*)"/.exec(made[DESCRIPTION]);
  const contents = bytesOf(JSON.stringify(made));
  const digits = [0, 1, 2, 3].map((begin) => checksum(contents, begin).toString(16).padStart(8, "0")).join("");
  const guid = `{${digits.replace(/^(.{8})(.{4})(.{4})(.{4})(.{12})$/, "$1-$2-$3-$4-$5")}}`;
  return zipped(Object.fromEntries(Object.entries(made).map(([path, text]) => [path, text.replaceAll(before, guid)])));
}

const fmuName = ({ name, matrices }) => `My${matrices ? "Linear" : name}.fmu`;

/** Hand the archive of the chosen law to whoever asks for it. */
async function downloadFmu() {
  const wanted = structuredClone(state.chosen);
  try {
    const address = URL.createObjectURL(await fmuOf(wanted));
    element("a", { href: address, download: fmuName(wanted) }).click();
    setTimeout(() => URL.revokeObjectURL(address), 60_000);
    $("#fmu-problem").textContent = "";
  } catch (problem) {
    $("#fmu-problem").textContent = `Not downloaded: ${problem.message}.`; // a browser of before 2023 has no DecompressionStream
  }
}
