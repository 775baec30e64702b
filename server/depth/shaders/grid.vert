// SPDX-License-Identifier: Apache-2.0
// The grid's cells, six vertices each, as ForEachPixel in grid_scan.cc takes them apart. Corner k of a cell
// (top left, top right, bottom left, bottom right) is the element corner_base[k] + place of the corner_
// buffers.
uniform isamplerBuffer corner_x;
uniform isamplerBuffer corner_y;
uniform isamplerBuffer corner_outcode;
uniform samplerBuffer corner_inverse_z;
uniform usamplerBuffer cells;  // enum Cell
uniform int corner_base[4];
uniform int cell_base;
uniform int cells_a_row;
uniform int places_a_row;

const int kUpper = 1;
const int kLower = 2;
const int kTurned = 4;
const int kOutsideTheView = 15;  // kLeft .. kBelow: no reason to leave a cell out
const int kMaxEdge = 60 * 256;

void main() {
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0);  // the same for a triangle's corners: nothing is drawn
  int cell = gl_VertexID / 6;
  int vertex = gl_VertexID % 6;
  int place = cell / cells_a_row * places_a_row + cell % cells_a_row;
  int parts = int(texelFetch(cells, cell_base + place).r);
  bool upper = (parts & kUpper) != 0;
  bool lower = (parts & kLower) != 0;
  if (vertex < 3 ? !upper : !lower) return;

  int order[4] = (parts & kTurned) != 0 ? int[4](1, 3, 0, 2) : int[4](0, 1, 2, 3);
  // A corner of no part is replaced by one of the other part: it must not count.
  int from[4] = int[4](upper ? 0 : 3, 1, 2, lower ? 3 : 0);
  ivec2 q[4];
  int any = 0;
  for (int k = 0; k < 4; ++k) {
    int at = corner_base[order[from[k]]] + place;
    q[k] = ivec2(texelFetch(corner_x, at).r, texelFetch(corner_y, at).r);
    any |= texelFetch(corner_outcode, at).r;
  }
  if ((any & ~kOutsideTheView) != 0) return;
  ivec2 low = min(min(q[0], q[1]), min(q[2], q[3]));
  ivec2 high = max(max(q[0], q[1]), max(q[2], q[3]));
  if (max(high.x - low.x, high.y - low.y) > kMaxEdge) return;

  int corner = int[6](0, 1, 2, 1, 3, 2)[vertex];
  float inverse_z = texelFetch(corner_inverse_z, corner_base[order[from[corner]]] + place).r;
  gl_Position = ClipOfCorner(q[corner], inverse_z);
}
