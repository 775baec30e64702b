# SPDX-License-Identifier: Apache-2.0
# Writes HEADER: every file of the list SHADERS as a string constant (mixstage_shaders in MixStage.cmake).
set(text "// Generated from the shaders/ folder.\n#pragma once\n#include <string_view>\n\nnamespace mixstage::shaders {\n")
foreach(shader IN LISTS SHADERS)
  get_filename_component(name ${shader} NAME)
  string(REPLACE "." "_" name ${name})
  file(READ ${shader} source)
  string(APPEND text "inline constexpr std::string_view ${name} = R\"glsl(${source})glsl\";\n")
endforeach()
file(WRITE ${HEADER} "${text}}  // namespace mixstage::shaders\n")
