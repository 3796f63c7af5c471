// Posed positions of skinned glTF files by three.js: GLTFLoader, AnimationMixer, SkinnedMesh.
//
// node rig_three.mjs NODE_MODULES < jobs.json
// jobs: [{file, out, poses: [[clip, seconds]], parts: [[mesh, primitive]], morphs}]; each `out` gets
// float64 [poses][vertices of all parts][3] in scene space. Without `morphs` no morph target counts;
// with it they do, as the file and its clip say but for those that it names: {name: weight}.
// Prints [{vertices, targets}] (names by part) or [{error}].
import { readFileSync, writeFileSync } from 'node:fs';
import path from 'node:path';
import { pathToFileURL } from 'node:url';

const modules = pathToFileURL(process.argv[2] + '/').href;
const THREE = await import(modules + 'three/build/three.module.js');
const { GLTFLoader } = await import(modules + 'three/examples/jsm/loaders/GLTFLoader.js');
globalThis.self = globalThis; // GLTFLoader asks a browser's name of it

function readBuffers(file, document, chunk) {
    return (document.buffers ?? []).map(({ uri }) => {
        if (uri === undefined) return chunk;
        if (uri.startsWith('data:')) return Buffer.from(uri.slice(uri.indexOf(',') + 1), 'base64');
        return readFileSync(path.join(path.dirname(file), decodeURIComponent(uri)));
    });
}

// One GLB with the geometry, skins and clips: nothing that would need a browser.
function repack(file) {
    const data = readFileSync(file);
    let document, chunk;
    if (data.toString('latin1', 0, 4) === 'glTF') {
        const size = data.readUInt32LE(12);
        document = JSON.parse(data.toString('utf8', 20, 20 + size));
        chunk = data.length > 28 + size ? data.subarray(28 + size) : Buffer.alloc(0);
    } else {
        document = JSON.parse(data.toString('utf8'));
    }
    const starts = [];
    const parts = [];
    let total = 0;
    for (const buffer of readBuffers(file, document, chunk)) {
        starts.push(total);
        parts.push(buffer, Buffer.alloc((8 - (buffer.length % 8)) % 8));
        total += buffer.length + parts.at(-1).length;
    }
    for (const view of document.bufferViews ?? []) {
        view.byteOffset = (view.byteOffset ?? 0) + starts[view.buffer];
        view.buffer = 0;
    }
    document.buffers = [{ byteLength: total }];
    for (const name of ['images', 'textures', 'samplers', 'materials', 'cameras', 'extensions',
                        'extensionsUsed', 'extensionsRequired']) delete document[name];
    for (const mesh of document.meshes ?? [])
        for (const primitive of mesh.primitives) {
            delete primitive.material;
            delete primitive.extensions;
        }
    for (const node of document.nodes ?? []) {
        delete node.camera;
        delete node.extensions;
    }
    const json = Buffer.from(JSON.stringify(document));
    const padding = Buffer.alloc((4 - (json.length % 4)) % 4, ' ');
    const head = Buffer.alloc(20);
    const binHead = Buffer.alloc(8);
    head.write('glTF', 'latin1');
    head.writeUInt32LE(2, 4);
    head.writeUInt32LE(28 + json.length + padding.length + total, 8);
    head.writeUInt32LE(json.length + padding.length, 12);
    head.write('JSON', 16, 'latin1');
    binHead.writeUInt32LE(total, 0);
    binHead.write('BIN\0', 4, 'latin1');
    const glb = Buffer.concat([head, json, padding, binHead, ...parts]);
    return glb.buffer.slice(glb.byteOffset, glb.byteOffset + glb.length);
}

// The first skinned mesh object that each (mesh, primitive) became, as skind takes the first use.
function findObjects(gltf, parts) {
    const found = new Map();
    for (const scene of gltf.scenes)
        scene.traverse((object) => {
            if (!object.isSkinnedMesh) return;
            let owner = object;
            let place = gltf.parser.associations.get(object) ?? {};
            const primitive = place.primitives ?? 0;
            while (place.nodes === undefined && owner.parent) {
                owner = owner.parent;
                place = { ...gltf.parser.associations.get(owner), ...place };
            }
            const key = `${place.meshes},${primitive}`;
            if (!found.has(key) || place.nodes < found.get(key).node)
                found.set(key, { node: place.nodes, object });
        });
    return parts.map(([mesh, primitive]) => {
        const entry = found.get(`${mesh},${primitive}`);
        if (!entry) throw new Error(`three.js has no skinned mesh ${mesh},${primitive}`);
        return entry.object;
    });
}

function pose(gltf, [clip, seconds]) {
    const root = new THREE.Group();
    root.add(...gltf.scenes);
    const mixer = new THREE.AnimationMixer(root);
    const action = mixer.clipAction(gltf.animations[clip]);
    action.setLoop(THREE.LoopOnce);
    action.clampWhenFinished = true;
    action.play();
    action.time = seconds;
    mixer.update(0);
    root.updateMatrixWorld(true);
    return () => mixer.stopAllAction();
}

// How strong each target is by name; three.js finds a name in the dictionary it made of targetNames.
function setInfluences(object, morphs) {
    for (const [name, weight] of Object.entries(morphs)) {
        const index = object.morphTargetDictionary?.[name];
        if (index !== undefined) object.morphTargetInfluences[index] = weight;
    }
}

async function run(job) {
    const gltf = await new GLTFLoader().parseAsync(repack(job.file), '');
    const objects = findObjects(gltf, job.parts);
    const count = objects.reduce((sum, object) => sum + object.geometry.attributes.position.count, 0);
    const out = new Float64Array(job.poses.length * count * 3);
    const point = new THREE.Vector3();
    let at = 0;
    for (const wanted of job.poses) {
        const undo = pose(gltf, wanted);
        for (const object of objects) {
            object.bindMatrixInverse.identity(); // scene space, not the mesh node's
            const positions = object.geometry.attributes.position;
            if (job.morphs) setInfluences(object, job.morphs);
            for (let v = 0; v < positions.count; v++) {
                if (job.morphs) object.getVertexPosition(v, point);
                else object.applyBoneTransform(v, point.fromBufferAttribute(positions, v));
                out[at++] = point.x;
                out[at++] = point.y;
                out[at++] = point.z;
            }
        }
        undo();
    }
    writeFileSync(job.out, out);
    return { vertices: count, targets: objects.map((object) => Object.keys(object.morphTargetDictionary ?? {})) };
}

const answers = [];
for (const job of JSON.parse(readFileSync(0, 'utf8')))
    answers.push(await run(job).catch((error) => ({ error: String(error) })));
console.log(JSON.stringify(answers));
