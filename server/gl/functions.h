// SPDX-License-Identifier: Apache-2.0
//
// The OpenGL 4.5 functions that passes use, loaded from the driver at run time: the program itself links no
// GL library.
#pragma once

#include <GL/glcorearb.h>

namespace mixstage::gl {

// clang-format off
#define MIXSTAGE_GL_FUNCTIONS(X)                                        \
  X(PFNGLGETSTRINGPROC, GetString)                                      \
  X(PFNGLGETINTEGERVPROC, GetIntegerv)                                  \
  X(PFNGLGETERRORPROC, GetError)                                        \
  X(PFNGLGETGRAPHICSRESETSTATUSPROC, GetGraphicsResetStatus)            \
  X(PFNGLENABLEPROC, Enable)                                            \
  X(PFNGLDISABLEPROC, Disable)                                          \
  X(PFNGLVIEWPORTPROC, Viewport)                                        \
  X(PFNGLCLIPCONTROLPROC, ClipControl)                                  \
  X(PFNGLDEPTHFUNCPROC, DepthFunc)                                      \
  X(PFNGLDEPTHMASKPROC, DepthMask)                                      \
  X(PFNGLCOLORMASKIPROC, ColorMaski)                                    \
  X(PFNGLCULLFACEPROC, CullFace)                                        \
  X(PFNGLFRONTFACEPROC, FrontFace)                                      \
  X(PFNGLDRAWARRAYSPROC, DrawArrays)                                    \
  X(PFNGLDRAWELEMENTSBASEVERTEXPROC, DrawElementsBaseVertex)            \
  X(PFNGLCREATEBUFFERSPROC, CreateBuffers)                              \
  X(PFNGLDELETEBUFFERSPROC, DeleteBuffers)                              \
  X(PFNGLBINDBUFFERPROC, BindBuffer)                                    \
  X(PFNGLNAMEDBUFFERDATAPROC, NamedBufferData)                          \
  X(PFNGLNAMEDBUFFERSUBDATAPROC, NamedBufferSubData)                    \
  X(PFNGLNAMEDBUFFERSTORAGEPROC, NamedBufferStorage)                    \
  X(PFNGLMAPNAMEDBUFFERRANGEPROC, MapNamedBufferRange)                  \
  X(PFNGLFENCESYNCPROC, FenceSync)                                      \
  X(PFNGLCLIENTWAITSYNCPROC, ClientWaitSync)                            \
  X(PFNGLDELETESYNCPROC, DeleteSync)                                    \
  X(PFNGLCREATETEXTURESPROC, CreateTextures)                            \
  X(PFNGLDELETETEXTURESPROC, DeleteTextures)                            \
  X(PFNGLTEXTURESTORAGE2DPROC, TextureStorage2D)                        \
  X(PFNGLTEXTURESUBIMAGE2DPROC, TextureSubImage2D)                      \
  X(PFNGLTEXTUREPARAMETERIPROC, TextureParameteri)                      \
  X(PFNGLTEXTUREBUFFERPROC, TextureBuffer)                              \
  X(PFNGLBINDTEXTUREUNITPROC, BindTextureUnit)                          \
  X(PFNGLPIXELSTOREIPROC, PixelStorei)                                  \
  X(PFNGLREADPIXELSPROC, ReadPixels)                                    \
  X(PFNGLCREATEFRAMEBUFFERSPROC, CreateFramebuffers)                    \
  X(PFNGLDELETEFRAMEBUFFERSPROC, DeleteFramebuffers)                    \
  X(PFNGLBINDFRAMEBUFFERPROC, BindFramebuffer)                          \
  X(PFNGLNAMEDFRAMEBUFFERTEXTUREPROC, NamedFramebufferTexture)          \
  X(PFNGLNAMEDFRAMEBUFFERDRAWBUFFERSPROC, NamedFramebufferDrawBuffers)  \
  X(PFNGLNAMEDFRAMEBUFFERREADBUFFERPROC, NamedFramebufferReadBuffer)    \
  X(PFNGLCHECKNAMEDFRAMEBUFFERSTATUSPROC, CheckNamedFramebufferStatus)  \
  X(PFNGLCLEARNAMEDFRAMEBUFFERFVPROC, ClearNamedFramebufferfv)          \
  X(PFNGLCLEARNAMEDFRAMEBUFFERIVPROC, ClearNamedFramebufferiv)          \
  X(PFNGLCREATESHADERPROC, CreateShader)                                \
  X(PFNGLDELETESHADERPROC, DeleteShader)                                \
  X(PFNGLSHADERSOURCEPROC, ShaderSource)                                \
  X(PFNGLCOMPILESHADERPROC, CompileShader)                              \
  X(PFNGLGETSHADERIVPROC, GetShaderiv)                                  \
  X(PFNGLGETSHADERINFOLOGPROC, GetShaderInfoLog)                        \
  X(PFNGLCREATEPROGRAMPROC, CreateProgram)                              \
  X(PFNGLDELETEPROGRAMPROC, DeleteProgram)                              \
  X(PFNGLATTACHSHADERPROC, AttachShader)                                \
  X(PFNGLLINKPROGRAMPROC, LinkProgram)                                  \
  X(PFNGLGETPROGRAMIVPROC, GetProgramiv)                                \
  X(PFNGLGETPROGRAMINFOLOGPROC, GetProgramInfoLog)                      \
  X(PFNGLGETUNIFORMLOCATIONPROC, GetUniformLocation)                    \
  X(PFNGLUSEPROGRAMPROC, UseProgram)                                    \
  X(PFNGLPROGRAMUNIFORM1IPROC, ProgramUniform1i)                        \
  X(PFNGLPROGRAMUNIFORM2IPROC, ProgramUniform2i)                        \
  X(PFNGLPROGRAMUNIFORM1FPROC, ProgramUniform1f)                        \
  X(PFNGLPROGRAMUNIFORM3FVPROC, ProgramUniform3fv)                      \
  X(PFNGLPROGRAMUNIFORM4FVPROC, ProgramUniform4fv)                      \
  X(PFNGLPROGRAMUNIFORMMATRIX4FVPROC, ProgramUniformMatrix4fv)          \
  X(PFNGLCREATEVERTEXARRAYSPROC, CreateVertexArrays)                    \
  X(PFNGLDELETEVERTEXARRAYSPROC, DeleteVertexArrays)                    \
  X(PFNGLBINDVERTEXARRAYPROC, BindVertexArray)                          \
  X(PFNGLVERTEXARRAYVERTEXBUFFERPROC, VertexArrayVertexBuffer)          \
  X(PFNGLVERTEXARRAYELEMENTBUFFERPROC, VertexArrayElementBuffer)        \
  X(PFNGLVERTEXARRAYATTRIBFORMATPROC, VertexArrayAttribFormat)          \
  X(PFNGLVERTEXARRAYATTRIBIFORMATPROC, VertexArrayAttribIFormat)        \
  X(PFNGLVERTEXARRAYATTRIBBINDINGPROC, VertexArrayAttribBinding)        \
  X(PFNGLENABLEVERTEXARRAYATTRIBPROC, EnableVertexArrayAttrib)
// clang-format on

struct Functions {
#define MIXSTAGE_GL_MEMBER(type, name) type name = nullptr;
  MIXSTAGE_GL_FUNCTIONS(MIXSTAGE_GL_MEMBER)
#undef MIXSTAGE_GL_MEMBER
};

}  // namespace mixstage::gl
