// SPDX-License-Identifier: Apache-2.0
// The decoder alone: draco3d's main file would bring the encoder along.
declare module 'draco3d/draco_decoder_nodejs.js' {
  import type { DracoDecoderModule } from 'draco3d';
  const create: DracoDecoderModule;
  export default create;
}
