// Errors that the Khronos glTF validator finds.
//
// node rig_validate.mjs NODE_MODULES < files.json
// files: [path]; prints [{code: count}] of messages with severity "error".
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import path from 'node:path';

const require = createRequire(path.join(process.argv[2], 'x.js'));
const validator = require('gltf-validator');

async function validate(file) {
    const report = await validator.validateBytes(new Uint8Array(readFileSync(file)), {
        maxIssues: 0,
        externalResourceFunction: async (uri) =>
            new Uint8Array(readFileSync(path.join(path.dirname(file), decodeURIComponent(uri)))),
    });
    const counts = {};
    for (const { code, severity } of report.issues.messages)
        if (severity === 0) counts[code] = (counts[code] ?? 0) + 1;
    return counts;
}

const answers = [];
for (const file of JSON.parse(readFileSync(0, 'utf8'))) answers.push(await validate(file));
console.log(JSON.stringify(answers));
