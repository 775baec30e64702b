// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/page_files.h"

#include <array>
#include <fstream>
#include <iterator>

namespace mixstage {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxFiles = 1000;
constexpr std::uintmax_t kMaxBytes = 64 << 20;

std::string_view MimeType(const std::string& extension) {
  struct Type {
    std::string_view extension, mime_type;
  };
  static constexpr std::array kTypes = {
      Type{".html", "text/html; charset=utf-8"},
      Type{".js", "text/javascript; charset=utf-8"},
      Type{".mjs", "text/javascript; charset=utf-8"},
      Type{".css", "text/css; charset=utf-8"},
      Type{".json", "application/json"},
      Type{".map", "application/json"},
      Type{".webmanifest", "application/manifest+json"},
      Type{".wasm", "application/wasm"},
      Type{".svg", "image/svg+xml"},
      Type{".png", "image/png"},
      Type{".jpg", "image/jpeg"},
      Type{".ico", "image/x-icon"},
      Type{".glb", "model/gltf-binary"},
      Type{".txt", "text/plain; charset=utf-8"},
  };
  for (const Type& type : kTypes) {
    if (extension == type.extension) return type.mime_type;
  }
  return "application/octet-stream";
}

}  // namespace

Result<PageFiles> PageFiles::Load(const fs::path& folder) {
  const auto refuse = [&folder](const std::string& why) {
    return Fail(ErrorCode::kBadInput, "page folder " + folder.string() + ": " + why);
  };
  PageFiles pages;
  std::uintmax_t bytes = 0;
  std::error_code error;
  fs::recursive_directory_iterator it(folder, error);
  for (; !error && it != fs::recursive_directory_iterator(); it.increment(error)) {
    std::error_code status_error;
    if (it->symlink_status(status_error).type() != fs::file_type::regular || status_error) continue;
    const std::uintmax_t size = it->file_size(status_error);
    if (status_error) return refuse(it->path().filename().string() + ": " + status_error.message());
    bytes += size;
    if (bytes > kMaxBytes || pages.files_.size() == kMaxFiles) {
      return refuse("holds more than 1,000 files or 64 MB; is it the page's folder?");
    }
    PageFile file;
    std::ifstream stream(it->path(), std::ios::binary);
    file.content.resize(size);
    if (!stream.read(file.content.data(), static_cast<std::streamsize>(size))) {
      return refuse(it->path().filename().string() + " cannot be read");
    }
    std::string url_path = "/";
    url_path += it->path().lexically_relative(folder).generic_string();
    file.mime_type = MimeType(it->path().extension().string());
    // The bundler names what lies in assets/ by its content: a changed file is another file.
    file.cache_control = url_path == "/index.html"          ? "no-store"
                         : url_path.starts_with("/assets/") ? "public, max-age=31536000, immutable"
                                                            : "no-cache";
    pages.files_.emplace(url_path, std::move(file));
  }
  if (error) return refuse(error.message());
  if (pages.Find("/") == nullptr) return refuse("has no index.html; build the page first");
  return pages;
}

const PageFile* PageFiles::Find(std::string_view url_path) const {
  const auto it = files_.find(url_path == "/" ? std::string_view("/index.html") : url_path);
  return it == files_.end() ? nullptr : &it->second;
}

}  // namespace mixstage
