// SPDX-License-Identifier: Apache-2.0
// Draco meshes of the fake show, and the binary messages of SPEC 4.1 and 4.3.
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { kRoom } from './fake_picture.mjs';

const require = createRequire(new URL('../../viewer_client/web/package.json', import.meta.url));
const draco = await require('draco3d').createEncoderModule({});
const kTexture = readFileSync(new URL('../../deploy/demo/page.jpg', import.meta.url));
const kIdentity = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];

/** Quads as a Draco bitstream. Each has four corners; with `uvs` or `normals` and `colors`. */
function encode(quads) {
  const mesh = new draco.Mesh();
  const builder = new draco.MeshBuilder();
  const points = 4 * quads.length;
  const faces = quads.flatMap((_, index) => [0, 1, 2, 0, 2, 3].map((corner) => 4 * index + corner));
  builder.AddFacesToMesh(mesh, 2 * quads.length, new Uint32Array(faces));
  const floats = (of) => new Float32Array(quads.flatMap((quad) => of(quad).flat()));
  builder.AddFloatAttribute(
    mesh,
    draco.POSITION,
    points,
    3,
    floats(({ corners }) => corners),
  );
  if (quads[0].uvs)
    builder.AddFloatAttribute(
      mesh,
      draco.TEX_COORD,
      points,
      2,
      floats(({ uvs }) => uvs),
    );
  if (quads[0].normal) {
    const normals = floats(({ normal }) => [normal, normal, normal, normal]);
    builder.AddFloatAttribute(mesh, draco.NORMAL, points, 3, normals);
    const colors = quads.flatMap(({ color }) => [color, color, color, color].flat());
    builder.AddUInt8Attribute(mesh, draco.COLOR, points, 3, new Uint8Array(colors));
  }
  const encoder = new draco.Encoder();
  encoder.SetEncodingMethod(draco.MESH_EDGEBREAKER_ENCODING);
  const out = new draco.DracoInt8Array();
  const bytes = encoder.EncodeMeshToDracoBuffer(mesh, out);
  const encoded = Buffer.from(Uint8Array.from({ length: bytes }, (_, index) => out.GetValue(index) & 255));
  for (const made of [out, encoder, builder, mesh]) draco.destroy(made);
  return encoded;
}

function header(stream, frame, now_us, payload, flags, { near_m = 0, far_m = 0 } = {}) {
  const head = Buffer.alloc(48);
  head.write('MXW1');
  head.writeUInt8(stream, 4);
  head.writeUInt8(flags, 5);
  head.writeUInt16LE(48, 6);
  head.writeBigUInt64LE(BigInt(frame), 8);
  head.writeBigInt64LE(BigInt(now_us), 16);
  head.writeBigInt64LE(BigInt(now_us), 24);
  head.writeUInt32LE(payload.length, 32);
  head.writeFloatLE(near_m, 36);
  head.writeFloatLE(far_m, 40);
  return Buffer.concat([head, payload]);
}

export function pictureMessage(stream, frame, now_us, payload, range) {
  return header(stream, frame, now_us, payload, 1, range);
}

export function meshMessage(stream, id, { mesh, texture = Buffer.alloc(0), T = kIdentity }, frame, now_us) {
  const prefix = Buffer.alloc(60);
  prefix.writeUInt32LE(id, 0);
  prefix.writeUInt32LE(mesh.length, 4);
  prefix.writeUInt32LE(texture.length, 8);
  T.slice(0, 12).forEach((number, index) => prefix.writeFloatLE(number, 12 + 4 * index));
  return header(stream, frame, now_us, Buffer.concat([prefix, mesh, texture]), 1);
}

/** The room as its camera saw it: floor, far wall, two side walls, textured with a picture of the demonstration. */
export function roomMesh() {
  const { x, y, z } = kRoom;
  const uvs = (left, right, top, foot) => [
    [left, foot],
    [right, foot],
    [right, top],
    [left, top],
  ];
  const quads = [
    // The far wall, the floor, left and right wall; texture out of the program picture of the demonstration.
    {
      corners: [
        [x[1], y[1], 0],
        [x[1], y[0], 0],
        [x[1], y[0], z[1]],
        [x[1], y[1], z[1]],
      ],
      uvs: uvs(0.1, 0.5, 0.12, 0.5),
    },
    {
      corners: [
        [1, y[1], 0],
        [1, y[0], 0],
        [x[1], y[0], 0],
        [x[1], y[1], 0],
      ],
      uvs: uvs(0.1, 0.5, 0.72, 0.88),
    },
    {
      corners: [
        [1, y[1], 0],
        [x[1], y[1], 0],
        [x[1], y[1], z[1]],
        [1, y[1], z[1]],
      ],
      uvs: uvs(0.02, 0.1, 0.12, 0.5),
    },
    {
      corners: [
        [x[1], y[0], 0],
        [1, y[0], 0],
        [1, y[0], z[1]],
        [x[1], y[0], z[1]],
      ],
      uvs: uvs(0.5, 0.56, 0.12, 0.5),
    },
  ];
  return { mesh: encode(quads), texture: kTexture };
}

/** The actor: an upright picture of 0.5 x 1.75 m that faces the camera. */
export function actorMesh([x, y], T) {
  const corners = [
    [x, y + 0.25, 0],
    [x, y - 0.25, 0],
    [x, y - 0.25, 1.75],
    [x, y + 0.25, 1.75],
  ];
  const uvs = [
    [0.3, 0.8],
    [0.36, 0.8],
    [0.36, 0.3],
    [0.3, 0.3],
  ];
  return { mesh: encode([{ corners, uvs }]), texture: kTexture, T };
}

/** A box of an object, in its own coordinates: upright, its base in the origin. */
export function boxMesh({ half, height, color }) {
  const h = half;
  const face = (normal, corners) => ({ normal, corners, color });
  return {
    mesh: encode([
      face(
        [0, 0, 1],
        [
          [-h, -h, height],
          [h, -h, height],
          [h, h, height],
          [-h, h, height],
        ],
      ),
      face(
        [0, -1, 0],
        [
          [-h, -h, 0],
          [h, -h, 0],
          [h, -h, height],
          [-h, -h, height],
        ],
      ),
      face(
        [1, 0, 0],
        [
          [h, -h, 0],
          [h, h, 0],
          [h, h, height],
          [h, -h, height],
        ],
      ),
      face(
        [0, 1, 0],
        [
          [h, h, 0],
          [-h, h, 0],
          [-h, h, height],
          [h, h, height],
        ],
      ),
      face(
        [-1, 0, 0],
        [
          [-h, h, 0],
          [-h, -h, 0],
          [-h, -h, height],
          [-h, h, height],
        ],
      ),
    ]),
  };
}
