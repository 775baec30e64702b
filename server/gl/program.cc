// SPDX-License-Identifier: Apache-2.0
#include "server/gl/program.h"

#include <string>
#include <vector>

namespace mixstage::gl {
namespace {

constexpr std::string_view kVersion = "#version 450 core\n";

std::string LogOf(GLuint id, PFNGLGETSHADERIVPROC get, PFNGLGETSHADERINFOLOGPROC log) {
  GLint length = 0;
  get(id, GL_INFO_LOG_LENGTH, &length);
  std::string text(static_cast<std::size_t>(length > 0 ? length : 0), '\0');
  if (length > 0) log(id, length, nullptr, text.data());
  while (!text.empty() && (text.back() == '\0' || text.back() == '\n')) text.pop_back();
  return text;
}

// Attaches it to the program, which then keeps it.
Status Compile(const Current& current, GLuint program, GLenum stage,
               std::initializer_list<std::string_view> parts) {
  std::vector<const GLchar*> texts = {kVersion.data()};
  std::vector<GLint> lengths = {static_cast<GLint>(kVersion.size())};
  for (const std::string_view part : parts) {
    texts.push_back(part.data());
    lengths.push_back(static_cast<GLint>(part.size()));
  }
  const GLuint shader = current->CreateShader(stage);
  current->ShaderSource(shader, static_cast<GLsizei>(texts.size()), texts.data(), lengths.data());
  current->CompileShader(shader);
  GLint good = GL_FALSE;
  current->GetShaderiv(shader, GL_COMPILE_STATUS, &good);
  Status status;
  if (good != GL_TRUE) {
    status = Fail(ErrorCode::kInternal, "the driver refuses its shader: " +
                                            LogOf(shader, current->GetShaderiv, current->GetShaderInfoLog));
  } else {
    current->AttachShader(program, shader);
  }
  current->DeleteShader(shader);
  return status;
}

}  // namespace

Result<Program> Program::Create(const Current& current, std::string_view name,
                                std::initializer_list<std::string_view> vertex,
                                std::initializer_list<std::string_view> fragment) {
  const GLuint id = current->CreateProgram();
  Program program(Name(current, Name::Kind::kProgram, id));
  const std::string place = "program " + std::string(name);
  if (auto ok = Compile(current, id, GL_VERTEX_SHADER, vertex); !ok) return Within(place, ok.error());
  if (auto ok = Compile(current, id, GL_FRAGMENT_SHADER, fragment); !ok) return Within(place, ok.error());
  current->LinkProgram(id);
  GLint good = GL_FALSE;
  current->GetProgramiv(id, GL_LINK_STATUS, &good);
  if (good != GL_TRUE) {
    return Fail(ErrorCode::kInternal, place + ": the driver refuses to link it: " +
                                          LogOf(id, current->GetProgramiv, current->GetProgramInfoLog));
  }
  if (auto ok = current.Check(place.c_str()); !ok) return tl::unexpected(ok.error());
  return program;
}

GLint Program::At(const Current& current, const char* uniform) const {
  return current->GetUniformLocation(name_.id(), uniform);
}
void Program::Use(const Current& current) const { current->UseProgram(name_.id()); }
void Program::Set(const Current& current, const char* uniform, int value) const {
  current->ProgramUniform1i(name_.id(), At(current, uniform), value);
}
void Program::Set(const Current& current, const char* uniform, int x, int y) const {
  current->ProgramUniform2i(name_.id(), At(current, uniform), x, y);
}
void Program::Set(const Current& current, const char* uniform, float value) const {
  current->ProgramUniform1f(name_.id(), At(current, uniform), value);
}
void Program::Set3(const Current& current, const char* uniform, const float* values, int count) const {
  current->ProgramUniform3fv(name_.id(), At(current, uniform), count, values);
}
void Program::Set4(const Current& current, const char* uniform, const float* values, int count) const {
  current->ProgramUniform4fv(name_.id(), At(current, uniform), count, values);
}
void Program::SetMatrix(const Current& current, const char* uniform, const float* values) const {
  current->ProgramUniformMatrix4fv(name_.id(), At(current, uniform), 1, GL_FALSE, values);
}

}  // namespace mixstage::gl
