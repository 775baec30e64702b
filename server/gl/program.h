// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <initializer_list>
#include <string_view>

#include "server/gl/context.h"

namespace mixstage::gl {

// A vertex and a fragment shader, linked. Sources are the files of a shaders/ folder, embedded at build time
// as mixstage_shaders/<folder>.h (cmake/MixStage.cmake: mixstage_shaders); they carry no #version line. Parts
// of one shader are compiled as if they stood in one file.
class Program {
 public:
  // Fails (kInternal) with the driver's words.
  static Result<Program> Create(const Current& current, std::string_view name,
                                std::initializer_list<std::string_view> vertex,
                                std::initializer_list<std::string_view> fragment);
  void Use(const Current& current) const;
  // Uniforms by the name they have in the shader; one that the shader does not use is no error.
  void Set(const Current& current, const char* uniform, int value) const;
  void Set(const Current& current, const char* uniform, int x, int y) const;
  void Set(const Current& current, const char* uniform, float value) const;
  void Set3(const Current& current, const char* uniform, const float* values, int count = 1) const;
  void Set4(const Current& current, const char* uniform, const float* values, int count = 1) const;
  // Column-major.
  void SetMatrix(const Current& current, const char* uniform, const float* values) const;

 private:
  explicit Program(Name name) : name_(std::move(name)) {}
  [[nodiscard]] GLint At(const Current& current, const char* uniform) const;
  Name name_;
};

}  // namespace mixstage::gl
