// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace mixstage {

// printf's text, of any length.
[[gnu::format(printf, 1, 2)]] std::string Text(const char* format, ...);

// For the inside of HTML and of its quoted attributes: file names and notes come from strangers.
std::string EscapedHtml(const std::string& text);

}  // namespace mixstage
