// SPDX-License-Identifier: Apache-2.0
#include "server/app/access_commands.h"

#include <algorithm>
#include <cstdio>

#include "server/delivery/tls_certificate.h"
#include "server/delivery/token_store.h"

namespace mixstage {

TokenCommand::TokenCommand(CLI::App& app)
    : command_(app.add_subcommand("token", "who may log in: makes, lists and revokes tokens")),
      make_(command_->add_subcommand("make", "makes a token and prints it, once")),
      list_(command_->add_subcommand("list", "prints name, role and date of every token")),
      revoke_(command_->add_subcommand("revoke", "ends a token; its viewers are closed")) {
  command_->require_subcommand(1);
  for (CLI::App* command : {make_, list_, revoke_}) {
    command->add_option("--file", file_, "the token file, also given to: run --tokens")->required();
  }
  for (CLI::App* command : {make_, revoke_}) {
    command->add_option("--name", name_, "whose token it is: letters, digits and . _ - @")->required();
  }
  make_->add_option("--role", role_, "viewer watches, director edits the scene too")
      ->required()
      ->check(CLI::IsMember({"viewer", "director"}));
  command_->footer("Example: mixstage-server token make --file tokens.json --name anna --role director");
}

Status TokenCommand::Run() const {
  if (make_->parsed()) {
    const Result<WatchRole> role = ParseRole(role_);
    if (!role) return tl::unexpected(role.error());
    const Result<std::string> token = MakeToken(file_, name_, *role);
    if (!token) return tl::unexpected(token.error());
    std::puts(token->c_str());
    return {};
  }
  if (revoke_->parsed()) return RevokeToken(file_, name_);
  const Result<TokenStore> store = TokenStore::Load(file_);
  if (!store) return tl::unexpected(store.error());
  std::size_t widest = 0;
  for (const Token& token : store->tokens()) widest = std::max(widest, token.name.size());
  for (const Token& token : store->tokens()) {
    std::printf("%-*s  %-8s  %s\n", static_cast<int>(widest), token.name.c_str(),
                std::string(RoleName(token.role)).c_str(), token.created.c_str());
  }
  return {};
}

CertificateCommand::CertificateCommand(CLI::App& app)
    : command_(
          app.add_subcommand("certificate", "makes a self-signed certificate, for studios that have none")) {
  command_->add_option("--out", out_, "folder for certificate.pem and key.pem")->required();
  command_->add_option("--host", hosts_, "a name or address that viewers call the server by; again for more")
      ->required();
  command_->footer("Example: mixstage-server certificate --out tls --host studio.example --host 192.0.2.7");
}

Status CertificateCommand::Run() const { return MakeSelfSignedCertificate(out_, hosts_); }

}  // namespace mixstage
