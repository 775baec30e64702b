// SPDX-License-Identifier: Apache-2.0
//
// One encode for many viewers: what `serve` pays for them, and what one that never reads does to the others.
//
//   bench_fanout [VIEWERS [SECONDS]]      default 100 viewers of 2 Mb/s, 5 s a row
//
// Loopback, plain and by TLS. The viewers are raw sockets in one thread of this process; their cost is not
// counted.
#include <fcntl.h>
#include <netinet/in.h>
#include <openssl/ssl.h>
#include <sys/epoll.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "proto/base/check.h"
#include "proto/base/clock.h"
#include "server/delivery/gateway.h"

namespace mixstage {
namespace {

constexpr int kFps = 30;
constexpr std::size_t kPayloadBytes = 2'000'000 / 8 / (2 * kFps) - kWatchHeaderBytes;  // both streams: 2 Mb/s

// One viewer's socket, read without ever waiting.
class RawViewer {
 public:
  // tls: nothing for a plain connection.
  RawViewer(std::uint16_t port, SSL_CTX* tls, int receive_buffer_bytes = 0)
      : fd_(socket(AF_INET, SOCK_STREAM, 0)) {
    if (receive_buffer_bytes > 0)
      setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &receive_buffer_bytes, sizeof receive_buffer_bytes);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    MIX_CHECK(connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0);
    if (tls != nullptr) {
      ssl_ = SSL_new(tls);
      SSL_set_fd(ssl_, fd_);
      MIX_CHECK(SSL_connect(ssl_) == 1);
    }
    const std::string request = "GET /watch HTTP/1.1\r\nHost: localhost:" + std::to_string(port) +
                                "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: "
                                "13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n";
    Write(request);
    std::string response;
    while (!response.ends_with("\r\n\r\n")) {
      char c = 0;
      MIX_CHECK(ReadSome(&c, 1) == 1);
      response += c;
    }
    MIX_CHECK(response.starts_with("HTTP/1.1 101"));
    fcntl(fd_, F_SETFL, O_NONBLOCK);
  }
  RawViewer(const RawViewer&) = delete;
  RawViewer& operator=(const RawViewer&) = delete;
  ~RawViewer() {
    SSL_free(ssl_);
    close(fd_);
  }

  [[nodiscard]] int fd() const { return fd_; }

  // Takes all that is there; the age of every picture that is complete goes to ages_us.
  void Drain(std::vector<std::int64_t>& ages_us) {
    std::array<std::uint8_t, 65536> bytes;
    for (;;) {
      const ssize_t got = ReadSome(bytes.data(), bytes.size());
      if (got <= 0) return;
      for (std::size_t i = 0; i < static_cast<std::size_t>(got);)
        i += Take(bytes.data() + i, got - i, ages_us);
    }
  }

 private:
  void Write(const std::string& text) {
    const int size = static_cast<int>(text.size());
    MIX_CHECK((ssl_ != nullptr ? SSL_write(ssl_, text.data(), size) : write(fd_, text.data(), text.size())) ==
              size);
  }
  ssize_t ReadSome(void* bytes, std::size_t size) {
    return ssl_ != nullptr ? SSL_read(ssl_, bytes, static_cast<int>(size)) : read(fd_, bytes, size);
  }

  // Up to `size` bytes of a WebSocket stream; how many were used.
  std::size_t Take(const std::uint8_t* bytes, std::size_t size, std::vector<std::int64_t>& ages_us) {
    if (left_ == 0) {
      frame_head_[frame_head_bytes_++] = bytes[0];
      const std::size_t code = frame_head_bytes_ < 2 ? 0 : frame_head_[1];
      const std::size_t needed = code == 127 ? 10 : code == 126 ? 4 : 2;
      if (frame_head_bytes_ < needed) return 1;
      left_ = code;
      if (needed > 2) {
        left_ = 0;
        for (std::size_t i = 2; i < needed; ++i) left_ = left_ << 8 | frame_head_[i];
      }
      frame_head_bytes_ = 0;
      picture_head_bytes_ = 0;
      return 1;
    }
    const std::size_t used = std::min(size, left_);
    const std::size_t wanted = std::min(used, picture_head_.size() - picture_head_bytes_);
    std::memcpy(picture_head_.data() + picture_head_bytes_, bytes, wanted);
    picture_head_bytes_ += wanted;
    left_ -= used;
    if (left_ == 0 && (frame_head_[0] & 0x0F) == 2) {
      std::int64_t encoded_us = 0;
      std::memcpy(&encoded_us, picture_head_.data() + 24, sizeof encoded_us);
      ages_us.push_back(MonotonicMicros() - encoded_us);
    }
    return used;
  }

  int fd_;
  SSL* ssl_ = nullptr;
  std::array<std::uint8_t, 10> frame_head_{};
  std::size_t frame_head_bytes_ = 0;
  std::size_t left_ = 0;  // of the frame's payload
  std::array<std::uint8_t, kWatchHeaderBytes> picture_head_{};
  std::size_t picture_head_bytes_ = 0;
};

// CPU time of a thread of this process, by its name.
double ThreadCpuMs(const std::string& name) {
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
    std::string comm;
    std::getline(std::ifstream(task.path() / "comm"), comm);
    double cpu_ns = 0;
    if (comm == name && std::ifstream(task.path() / "schedstat") >> cpu_ns) return cpu_ns * 1e-6;
  }
  return 0;
}

enum class Stalled { kNone = 1, kOne };

// tls: the gateway's certificate; empty = plain.
void Row(const char* name, const TlsFiles& tls, int viewers, int seconds, Stalled stalled) {
  GatewayConfig config{.listen = "127.0.0.1:0", .tls = tls};
  config.max_connections = config.max_viewers = viewers + 1;
  config.stall_timeout_s = 600;
  Gateway gateway(config);
  MIX_CHECK(gateway.Start().has_value());
  std::vector<std::unique_ptr<RawViewer>> all;
  const std::unique_ptr<SSL_CTX, decltype(&SSL_CTX_free)> context(
      tls.empty() ? nullptr : SSL_CTX_new(TLS_client_method()), SSL_CTX_free);
  const int epoll = epoll_create1(0);
  for (int i = 0; i < viewers; ++i) {
    all.push_back(std::make_unique<RawViewer>(gateway.port(), context.get()));
    epoll_event event{.events = EPOLLIN, .data = {.ptr = all.back().get()}};
    epoll_ctl(epoll, EPOLL_CTL_ADD, all.back()->fd(), &event);
  }
  std::unique_ptr<RawViewer> deaf;
  if (stalled == Stalled::kOne) deaf = std::make_unique<RawViewer>(gateway.port(), context.get(), 4096);

  std::vector<std::int64_t> ages_us;
  ages_us.reserve(static_cast<std::size_t>(viewers * seconds * 2 * kFps + 1000));
  std::jthread reader([&](const std::stop_token& stop) {
    std::array<epoll_event, 64> events;
    while (!stop.stop_requested()) {
      const int n = epoll_wait(epoll, events.data(), static_cast<int>(events.size()), 20);
      for (int i = 0; i < n; ++i)
        static_cast<RawViewer*>(events[static_cast<std::size_t>(i)].data.ptr)->Drain(ages_us);
    }
  });

  const std::vector<std::uint8_t> payload(kPayloadBytes, 0x42);
  const double cpu_before_ms = ThreadCpuMs("serve");
  const std::int64_t start_us = MonotonicMicros();
  for (int frame = 0; frame < seconds * kFps; ++frame) {
    for (const WatchStream stream : {WatchStream::kColor, WatchStream::kDepth}) {
      WatchHeader header{.stream = stream, .key_frame = frame % 60 == 0};
      header.frame = static_cast<std::uint64_t>(frame);
      header.encoded_us = MonotonicMicros();
      if (stream == WatchStream::kDepth) header.near_m = 1, header.far_m = 6;
      gateway.Publish(MakeWatchPicture(header, payload));
    }
    const std::int64_t next_us = start_us + (frame + 1) * 1'000'000LL / kFps;
    if (const std::int64_t wait_us = next_us - MonotonicMicros(); wait_us > 0)
      std::this_thread::sleep_for(std::chrono::microseconds(wait_us));
  }
  const double wall_ms = static_cast<double>(MonotonicMicros() - start_us) * 1e-3;
  const double cpu_ms = ThreadCpuMs("serve") - cpu_before_ms;
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  reader.request_stop();
  reader.join();
  close(epoll);
  std::sort(ages_us.begin(), ages_us.end());
  const auto at = [&](double share) {
    return ages_us.empty()
               ? 0.0
               : static_cast<double>(
                     ages_us[static_cast<std::size_t>(share * static_cast<double>(ages_us.size() - 1))]) *
                     1e-3;
  };
  const double core = cpu_ms / wall_ms;
  std::printf("%-22s %5d viewers: serve %5.1f %% of a core (%.0f viewers a core, %.1f us a picture), ", name,
              viewers, core * 100, viewers / core, cpu_ms * 1e3 / (viewers * seconds * 2 * kFps));
  std::printf("latency ms p50 %.2f p99 %.2f max %.2f, delivered %.4f\n", at(0.5), at(0.99), at(1),
              static_cast<double>(ages_us.size()) / (viewers * seconds * 2 * kFps));
}

}  // namespace
}  // namespace mixstage

int main(int argc, char** argv) {
  using namespace mixstage;
  const int viewers = argc > 1 ? std::atoi(argv[1]) : 100;
  const int seconds = argc > 2 ? std::atoi(argv[2]) : 5;
  if (viewers < 1 || viewers > 2000 || seconds < 1 || seconds > 60) {
    std::fprintf(stderr, "bench_fanout [VIEWERS (1..2000) [SECONDS (1..60)]]\n");
    return 2;
  }
  rlimit files{.rlim_cur = 8192, .rlim_max = 8192};
  setrlimit(RLIMIT_NOFILE, &files);
  const std::filesystem::path folder =
      std::filesystem::temp_directory_path() / ("mixstage_fanout_" + std::to_string(getpid()));
  MIX_CHECK(MakeSelfSignedCertificate(folder, {"localhost"}).has_value());
  const TlsFiles plain, tls{folder / "certificate.pem", folder / "key.pem"};
  Row("plain", plain, viewers, seconds, Stalled::kNone);
  Row("plain, one never reads", plain, viewers, seconds, Stalled::kOne);
  Row("TLS", tls, viewers, seconds, Stalled::kNone);
  Row("TLS, one never reads", tls, viewers, seconds, Stalled::kOne);
  std::filesystem::remove_all(folder);
  return 0;
}
