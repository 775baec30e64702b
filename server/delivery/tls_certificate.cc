// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/tls_certificate.h"

#include <fcntl.h>
#include <openssl/ec.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/rand.h>
#include <openssl/ssl.h>
#include <openssl/x509.h>
#include <openssl/x509v3.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <boost/asio/ip/address.hpp>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <optional>
#include <string_view>
#include <utility>

#include "server/delivery/owned_fd.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;
namespace ssl = boost::asio::ssl;

constexpr int kDays = 825;
constexpr std::size_t kMaxHosts = 100;
constexpr const char* kTls12Ciphers =
    "ECDHE-ECDSA-AES128-GCM-SHA256:ECDHE-RSA-AES128-GCM-SHA256:ECDHE-ECDSA-AES256-GCM-SHA384:"
    "ECDHE-RSA-AES256-GCM-SHA384:ECDHE-ECDSA-CHACHA20-POLY1305:ECDHE-RSA-CHACHA20-POLY1305";

// OpenSSL's objects are freed by their own functions.
template <auto Free>
struct Freed {
  template <typename T>
  void operator()(T* object) const {
    Free(object);
  }
};
using Key = std::unique_ptr<EVP_PKEY, Freed<EVP_PKEY_free>>;
using Certificate = std::unique_ptr<X509, Freed<X509_free>>;
using Bio = std::unique_ptr<BIO, Freed<BIO_free_all>>;
using Names = std::unique_ptr<GENERAL_NAMES, Freed<GENERAL_NAMES_free>>;

// The newest of OpenSSL's complaints in its own words, and none left for whoever asks next.
std::string OpenSslReason() {
  const char* reason = ERR_reason_error_string(ERR_peek_last_error());
  ERR_clear_error();
  return reason != nullptr ? reason : "unknown reason";
}

tl::unexpected<Error> Refuse(const fs::path& file, const std::string& why) {
  return Fail(ErrorCode::kInvalidConfig, file.string() + ": " + why);
}

// Of a certificate that is in use: everything in it was chosen by whoever runs the server.
std::vector<std::string> NamesOf(const X509* certificate) {
  std::vector<std::string> names;
  const Names general(
      static_cast<GENERAL_NAMES*>(X509_get_ext_d2i(certificate, NID_subject_alt_name, nullptr, nullptr)));
  for (int i = 0; i < sk_GENERAL_NAME_num(general.get()); ++i) {
    const GENERAL_NAME* name = sk_GENERAL_NAME_value(general.get(), i);
    if (name->type != GEN_DNS && name->type != GEN_IPADD) continue;
    const ASN1_STRING* value = name->type == GEN_DNS ? name->d.dNSName : name->d.iPAddress;
    const unsigned char* bytes = ASN1_STRING_get0_data(value);
    const auto size = static_cast<std::size_t>(ASN1_STRING_length(value));
    if (name->type == GEN_DNS) {
      std::string text(reinterpret_cast<const char*>(bytes), size);
      for (char& c : text) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
      names.push_back(std::move(text));
    } else if (size == 4) {
      boost::asio::ip::address_v4::bytes_type v4{};
      std::copy_n(bytes, size, v4.begin());
      names.push_back(boost::asio::ip::make_address_v4(v4).to_string());
    } else if (size == 16) {
      boost::asio::ip::address_v6::bytes_type v6{};
      std::copy_n(bytes, size, v6.begin());
      names.push_back(boost::asio::ip::make_address_v6(v6).to_string());
    }
  }
  return names;
}

bool IsDnsName(std::string_view host) {
  if (host.starts_with("*.")) host.remove_prefix(2);
  if (host.empty() || host.size() > 253 || host.front() == '.' || host.back() == '.') return false;
  if (host.find("..") != std::string_view::npos) return false;
  return std::ranges::all_of(host, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '.';
  });
}

bool AddHost(GENERAL_NAMES* names, const std::string& host) {
  boost::system::error_code no_address;
  const auto address = boost::asio::ip::make_address(host, no_address);
  std::string bytes = host;
  if (!no_address && address.is_v4()) {
    const auto v4 = address.to_v4().to_bytes();
    bytes.assign(v4.begin(), v4.end());
  } else if (!no_address) {
    const auto v6 = address.to_v6().to_bytes();
    bytes.assign(v6.begin(), v6.end());
  } else if (!IsDnsName(host)) {
    return false;
  }
  std::unique_ptr<ASN1_STRING, Freed<ASN1_STRING_free>> value(
      ASN1_STRING_type_new(no_address ? V_ASN1_IA5STRING : V_ASN1_OCTET_STRING));
  std::unique_ptr<GENERAL_NAME, Freed<GENERAL_NAME_free>> name(GENERAL_NAME_new());
  if (value == nullptr || name == nullptr ||
      ASN1_STRING_set(value.get(), bytes.data(), static_cast<int>(bytes.size())) != 1) {
    return false;
  }
  GENERAL_NAME_set0_value(name.get(), no_address ? GEN_DNS : GEN_IPADD, value.release());
  if (sk_GENERAL_NAME_push(names, name.get()) <= 0) return false;
  static_cast<void>(name.release());  // the list's now
  return true;
}

bool AddExtension(X509* certificate, int nid, const char* value) {
  X509V3_CTX context;
  X509V3_set_ctx_nodb(&context);
  X509V3_set_ctx(&context, certificate, certificate, nullptr, nullptr, 0);
  const std::unique_ptr<X509_EXTENSION, Freed<X509_EXTENSION_free>> extension(
      X509V3_EXT_conf_nid(nullptr, &context, nid, value));
  return extension != nullptr && X509_add_ext(certificate, extension.get(), -1) == 1;
}

// Signed by its own key, or nothing (OpenSSL knows why). Without key usage: a client that is told to trust it
// would look for the right to sign certificates there, which a server's must not have.
Certificate SelfSign(EVP_PKEY* key, const Names& names) {
  Certificate certificate(X509_new());
  std::array<unsigned char, 16> serial{};
  if (certificate == nullptr || RAND_bytes(serial.data(), serial.size()) != 1) return nullptr;
  serial[0] = static_cast<unsigned char>((serial[0] & 0x7F) | 0x40);  // positive, of full length
  const std::unique_ptr<BIGNUM, Freed<BN_free>> number(BN_bin2bn(serial.data(), serial.size(), nullptr));
  X509* x = certificate.get();
  X509_NAME* subject = X509_get_subject_name(x);
  const auto* common_name = reinterpret_cast<const unsigned char*>("MixStage self-signed");
  const bool made =
      number != nullptr && X509_set_version(x, X509_VERSION_3) == 1 &&
      BN_to_ASN1_INTEGER(number.get(), X509_get_serialNumber(x)) != nullptr &&
      X509_gmtime_adj(X509_getm_notBefore(x), -3600) != nullptr &&  // clocks differ
      X509_time_adj_ex(X509_getm_notAfter(x), kDays - 1, 86'400 - 3600, nullptr) != nullptr &&
      X509_set_pubkey(x, key) == 1 &&
      X509_NAME_add_entry_by_NID(subject, NID_commonName, MBSTRING_ASC, common_name, -1, -1, 0) == 1 &&
      X509_set_issuer_name(x, subject) == 1 && AddExtension(x, NID_basic_constraints, "critical,CA:FALSE") &&
      AddExtension(x, NID_ext_key_usage, "serverAuth") &&
      AddExtension(x, NID_subject_key_identifier, "hash") &&
      X509_add1_ext_i2d(x, NID_subject_alt_name, names.get(), 0, 0) == 1 &&
      X509_sign(x, key, EVP_sha256()) > 0;
  return made ? std::move(certificate) : nullptr;
}

std::string Text(BIO* bio) {
  char* bytes = nullptr;
  const long size = BIO_get_mem_data(bio, &bytes);
  return {bytes, static_cast<std::size_t>(size)};
}

// A new file: nothing that is there is replaced.
Status WriteNew(const fs::path& file, const std::string& text, mode_t mode) {
  const OwnedFd fd(open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, mode));
  if (!fd.valid() && errno == EEXIST) {
    return Refuse(file, "is there already; remove it first, or choose another folder with --out");
  }
  if (!fd.valid() || write(fd.get(), text.data(), text.size()) != static_cast<ssize_t>(text.size())) {
    return Fail(ErrorCode::kUnavailable, file.string() + " cannot be written: " + std::strerror(errno));
  }
  return {};
}

}  // namespace

Result<TlsCertificate> LoadTlsCertificate(const TlsFiles& files) {
  if (files.certificate.empty() || files.key.empty()) {
    return Fail(ErrorCode::kInvalidConfig,
                "TLS needs both a certificate and its key (tls: {certificate: FILE, key: FILE})");
  }
  struct stat about {};
  if (stat(files.key.c_str(), &about) != 0) return Refuse(files.key, std::strerror(errno));
  if ((about.st_mode & 07) != 0) {
    return Refuse(files.key, "everybody may open this key; run: chmod 600 " + files.key.string());
  }
  TlsCertificate loaded;
  loaded.context = std::make_shared<ssl::context>(ssl::context::tls_server);
  SSL_CTX* context = loaded.context->native_handle();
  SSL_CTX_set_min_proto_version(context, TLS1_2_VERSION);
  SSL_CTX_set_cipher_list(context, kTls12Ciphers);  // TLS 1.3's own are good as they are
  SSL_CTX_set_options(context, SSL_OP_NO_RENEGOTIATION | SSL_OP_NO_COMPRESSION | SSL_OP_NO_TICKET |
                                   SSL_OP_CIPHER_SERVER_PREFERENCE);
  SSL_CTX_set_num_tickets(context, 0);
  SSL_CTX_set_session_cache_mode(context, SSL_SESS_CACHE_OFF);
  SSL_CTX_set_mode(context, SSL_MODE_RELEASE_BUFFERS);
  // A passphrase would be asked for on a terminal that a service does not have.
  SSL_CTX_set_default_passwd_cb(context, [](char*, int, int, void*) { return 0; });
  ERR_clear_error();
  if (SSL_CTX_use_certificate_chain_file(context, files.certificate.c_str()) != 1) {
    return Refuse(files.certificate, "is no usable PEM certificate (" + OpenSslReason() + ")");
  }
  if (SSL_CTX_use_PrivateKey_file(context, files.key.c_str(), SSL_FILETYPE_PEM) != 1) {
    const bool other = ERR_GET_REASON(ERR_peek_last_error()) == X509_R_KEY_VALUES_MISMATCH;
    const std::string reason = OpenSslReason();
    return Refuse(files.key, other ? "this key is not the one of " + files.certificate.string()
                                   : "is no usable PEM key without a passphrase (" + reason + ")");
  }
  if (SSL_CTX_check_private_key(context) != 1) {
    ERR_clear_error();
    return Refuse(files.key, "this key is not the one of " + files.certificate.string());
  }
  const X509* certificate = SSL_CTX_get0_certificate(context);
  if (X509_cmp_current_time(X509_get0_notAfter(certificate)) < 0) {
    return Refuse(files.certificate, "has ended; a new one is made with: mixstage-server certificate");
  }
  loaded.names = NamesOf(certificate);
  if (loaded.names.empty()) return Refuse(files.certificate, "names no host (subjectAltName)");
  return loaded;
}

Status MakeSelfSignedCertificate(const fs::path& folder, const std::vector<std::string>& hosts) {
  if (hosts.empty() || hosts.size() > kMaxHosts) {
    return Fail(ErrorCode::kInvalidConfig, "give 1 to 100 hosts that the certificate is for: --host NAME");
  }
  const Names names(GENERAL_NAMES_new());
  for (const std::string& host : hosts) {
    if (names == nullptr || !AddHost(names.get(), host)) {
      return Fail(ErrorCode::kInvalidConfig,
                  "--host \"" + host + "\" is neither a host name nor an IP address");
    }
  }
  ERR_clear_error();
  const Key key(EVP_EC_gen("P-256"));
  const Certificate certificate = key != nullptr ? SelfSign(key.get(), names) : nullptr;
  const Bio key_text(BIO_new(BIO_s_mem())), certificate_text(BIO_new(BIO_s_mem()));
  if (certificate == nullptr || key_text == nullptr || certificate_text == nullptr ||
      PEM_write_bio_PKCS8PrivateKey(key_text.get(), key.get(), nullptr, nullptr, 0, nullptr, nullptr) != 1 ||
      PEM_write_bio_X509(certificate_text.get(), certificate.get()) != 1) {
    return Fail(ErrorCode::kInternal, "no certificate could be made (" + OpenSslReason() + ")");
  }
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return Fail(ErrorCode::kUnavailable, folder.string() + ": " + error.message());
  if (Status ok = WriteNew(folder / "key.pem", Text(key_text.get()), 0600); !ok) return ok;
  return WriteNew(folder / "certificate.pem", Text(certificate_text.get()), 0644);
}

}  // namespace mixstage
