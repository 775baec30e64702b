// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <string_view>

#include "proto/base/result.h"

namespace mixstage {

struct PageFile {
  std::string_view mime_type;
  std::string_view cache_control;
  std::string content;
};

// The built page, read once: a request is looked up by its whole path among these, so no path leads out of
// the folder. Immutable; any thread.
class PageFiles {
 public:
  // Nothing to serve.
  PageFiles() = default;
  // Reads the regular files of a folder and its folders (links are not followed). Fails (kBadInput) when the
  // folder has no index.html, or more than 1,000 files or 64 MB: then it is not the page's.
  static Result<PageFiles> Load(const std::filesystem::path& folder);

  // By the path of a URL, "/" being index.html; nothing when there is none.
  [[nodiscard]] const PageFile* Find(std::string_view url_path) const;
  [[nodiscard]] bool empty() const { return files_.empty(); }

 private:
  std::map<std::string, PageFile, std::less<>> files_;  // by "/path"
};

}  // namespace mixstage
