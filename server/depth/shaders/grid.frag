// SPDX-License-Identifier: Apache-2.0
// The depth buffer is all that is drawn.
void main() {}
