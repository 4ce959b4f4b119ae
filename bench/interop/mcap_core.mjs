// What @mcap/core, the format's own reader in TypeScript, finds in an MCAP file with every CRC checked.
//
// npm install @mcap/core @mcap/support
// node bench/interop/mcap_core.mjs FILE.mcap        (from where they are installed)
import { readFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";
import { join } from "node:path";

const require = createRequire(pathToFileURL(join(process.cwd(), "here.js")));
const { McapIndexedReader, McapStreamReader } = require("@mcap/core");
const { loadDecompressHandlers } = require("@mcap/support");

const data = await readFile(process.argv[2]);
const decompressHandlers = await loadDecompressHandlers();
const stream = new McapStreamReader({ validateCrcs: true, decompressHandlers });
stream.append(data);
let records = 0;
while (stream.nextRecord()) records++;
console.log(`read to the end with CRCs: ${stream.done()}, ${records} records\n`);

const readable = {
  size: async () => BigInt(data.length),
  read: async (offset, length) => new Uint8Array(data.subarray(Number(offset), Number(offset + length))),
};
const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
const counts = new Map();
for await (const message of reader.readMessages({ validateCrcs: true })) {
  const channel = reader.channelsById.get(message.channelId);
  const schema = reader.schemasById.get(channel.schemaId)?.name ?? "";
  const key = `| ${channel.topic} | ${schema} | ${channel.messageEncoding} |`;
  counts.set(key, (counts.get(key) ?? 0) + 1);
}
console.log("| topic | schema | encoding | messages |\n|---|---|---|---:|");
for (const [key, count] of [...counts].sort()) console.log(`${key} ${count} |`);
