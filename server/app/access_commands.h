// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "proto/base/result.h"

namespace mixstage {

// `mixstage-server token make|list|revoke`: the file of who may log in. Stays where it is made: the app
// writes what it parses into it.
class TokenCommand {
 public:
  explicit TokenCommand(CLI::App& app);
  TokenCommand(const TokenCommand&) = delete;
  TokenCommand& operator=(const TokenCommand&) = delete;
  [[nodiscard]] bool parsed() const { return command_->parsed(); }
  // `make` prints the token, which nobody can print again; `list` a line for each.
  Status Run() const;

 private:
  CLI::App *command_, *make_, *list_, *revoke_;
  std::string file_, name_, role_;
};

// `mixstage-server certificate`: a self-signed one. As above.
class CertificateCommand {
 public:
  explicit CertificateCommand(CLI::App& app);
  CertificateCommand(const CertificateCommand&) = delete;
  CertificateCommand& operator=(const CertificateCommand&) = delete;
  [[nodiscard]] bool parsed() const { return command_->parsed(); }
  Status Run() const;

 private:
  CLI::App* command_;
  std::string out_;
  std::vector<std::string> hosts_;
};

}  // namespace mixstage
