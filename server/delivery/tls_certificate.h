// SPDX-License-Identifier: Apache-2.0
//
// The gateway's side of TLS: a certificate with its key out of PEM files, and one made for a studio that has
// none.
#pragma once

#include <boost/asio/ssl/context.hpp>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "proto/base/result.h"

namespace mixstage {

struct TlsFiles {
  std::filesystem::path certificate{};  // PEM, the chain after it
  std::filesystem::path key{};          // PEM, without a passphrase, not open to everybody
  [[nodiscard]] bool empty() const { return certificate.empty() && key.empty(); }
};

struct TlsCertificate {
  std::shared_ptr<boost::asio::ssl::context> context;  // TLS 1.2 and 1.3, forward secrecy, no renegotiation
  std::vector<std::string> names;  // that it speaks for, lower case: "studio.example", "*.example",
                                   // "192.0.2.1"
};

// Fails (kInvalidConfig) with the file's name: missing, no PEM, a key that others may read or that belongs to
// another certificate, a certificate that has ended or names nothing.
Result<TlsCertificate> LoadTlsCertificate(const TlsFiles& files);

// Writes certificate.pem and key.pem (mode 0600) to a folder, which is made where it is missing: self-signed,
// ECDSA P-256, for these DNS names and IP addresses, for 825 days (what browsers take at most). Fails with
// kInvalidConfig on a host that is no name or address and where one of the files exists, kUnavailable when
// they cannot be written.
Status MakeSelfSignedCertificate(const std::filesystem::path& folder, const std::vector<std::string>& hosts);

}  // namespace mixstage
