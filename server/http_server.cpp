#include "server/http_server.h"

#include <fcntl.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <charconv>
#include <ctime>
#include <optional>
#include <set>
#include <sstream>
#include <thread>

#include "server/live_json.h"
#include "server/live_site.h"

namespace server {
namespace {

namespace beast = boost::beast;
namespace http = beast::http;
namespace net = boost::asio;
using beast::error_code;
using net::ip::tcp;
using world::Error;
using world::ErrorCode;
using world::Result;
using SteadyClock = std::chrono::steady_clock;

constexpr uint32_t kLongestHead = 8 * 1024;             ///< of a request [bytes]
constexpr int kSendBuffer = 256 * 1024;                 ///< what the kernel may hold for a slow watcher [bytes]
constexpr std::chrono::milliseconds kTick{100};         ///< between events
constexpr std::chrono::seconds kHeartbeat{5};           ///< a watcher hears at least as often
constexpr std::chrono::seconds kLastAnswers{2};         ///< answers under way at the end may take
constexpr std::chrono::milliseconds kAcceptPause{100};  ///< after the process ran out of descriptors

template <class Message>
void secure(Message& message) {
    message.set(http::field::cache_control, "no-store");
    message.set("Content-Security-Policy",
                "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
                "base-uri 'none'; form-action 'none'; frame-ancestors 'none'");
    message.set("X-Content-Type-Options", "nosniff");
    message.set("Referrer-Policy", "no-referrer");
    message.set("Cross-Origin-Resource-Policy", "same-origin");
}

/// Programs that the process starts must not keep its port.
void keepToProcess(int descriptor) { fcntl(descriptor, F_SETFD, FD_CLOEXEC); }

/// A name under which this host alone is reached. A page of another name that resolves to it is refused.
bool isOwnName(std::string_view host) {
    const size_t colon = host.rfind(':');
    if (colon != std::string_view::npos && host.find_first_not_of("0123456789", colon + 1) == std::string_view::npos)
        host = host.substr(0, colon);
    if (host == "localhost" || host == "[::1]") return true;
    error_code error;
    const auto address = net::ip::make_address_v4(host, error);
    return !error && address.is_loopback();
}

/// "STARTED.SESSION.NUMBER": what an event is called, so that a watcher that comes again goes on where it was.
std::string eventId(int64_t started, const LiveSeen& seen) {
    return std::to_string(started) + "." + std::to_string(seen.session) + "." + std::to_string(seen.number);
}

/// Where a watcher was, if the name is one of this process.
std::optional<LiveSeen> parseEventId(std::string_view id, int64_t started) {
    uint64_t parts[3] = {};
    const char *at = id.data(), *end = id.data() + id.size();
    for (int k = 0; k < 3; ++k) {
        const auto [rest, error] = std::from_chars(at, end, parts[k]);
        if (error != std::errc() || (k < 2 ? rest == end || *rest != '.' : rest != end)) return std::nullopt;
        at = rest + 1;
    }
    if (parts[0] != uint64_t(started)) return std::nullopt;
    return LiveSeen{parts[1], parts[2], 0};
}

}  // namespace

/// Everything but the constructor and the destructor runs on `thread`.
struct HttpServer::Impl {
    class Connection;
    Impl(LiveBoard& b, const HttpConfig& c) : board(b), config(c), acceptor(io), ticker(io), last(io), pause(io) {}

    void accept();
    void tick();
    void stop();
    void drop(const std::shared_ptr<Connection>& connection);

    LiveBoard& board;
    const HttpConfig config;
    const int64_t started = int64_t(std::time(nullptr));
    net::io_context io;
    tcp::acceptor acceptor;
    net::steady_timer ticker, last, pause;
    std::set<std::shared_ptr<Connection>> connections;
    size_t watchers = 0;
    bool stopping = false;
    uint16_t port = 0;
    std::thread thread;
};

class HttpServer::Impl::Connection : public std::enable_shared_from_this<Connection> {
public:
    Connection(Impl& server, tcp::socket socket) : server_(server), stream_(std::move(socket)) {}

    void read();
    void tick(const std::vector<LiveName>& sessions);
    /// At the end of the server: an answer under way may end.
    void finish() {
        if (state_ != State::kAnswering) close();
    }
    void close() { stream_.close(); }
    bool watches() const { return state_ == State::kWatching; }

private:
    enum class State { kReading, kAnswering, kWatching };
    using Request = http::request<http::empty_body>;

    void took(error_code error);
    void answer(const Request& request);
    void send(SiteAnswer answer, unsigned version, bool head, bool keep);
    void watch(LiveId session, std::string_view lastEvent);
    void listen();
    void push(std::string text);

    Impl& server_;
    beast::tcp_stream stream_;
    beast::flat_buffer buffer_{2 * kLongestHead};
    std::optional<http::request_parser<http::empty_body>> parser_;
    http::response<http::string_body> response_;
    State state_ = State::kReading;
    // Of a watcher.
    LiveId asked_ = 0;  ///< 0: whichever comes first
    LiveSeen seen_;
    std::string event_, told_;  ///< being written; the last one's content
    SteadyClock::time_point toldAt_;
    bool writing_ = false;
    char ignored_[256];
};

void HttpServer::Impl::Connection::read() {
    state_ = State::kReading;
    parser_.emplace();
    parser_->header_limit(kLongestHead);
    stream_.expires_after(server_.config.patience);
    http::async_read(stream_, buffer_, *parser_, [self = shared_from_this()](error_code error, size_t) { self->took(error); });
}

void HttpServer::Impl::Connection::took(error_code error) {
    if (server_.stopping) return server_.drop(shared_from_this());
    if (!error) return answer(parser_->get());
    if (error == http::error::header_limit || error == http::error::buffer_overflow)
        return send({431, "text/plain", "the head of the request is longer than 8 KiB\n", false, 0}, 11, false, false);
    if (error == http::error::unexpected_body || error == http::error::body_limit)
        return send({413, "text/plain", "no request here has a body\n", false, 0}, 11, false, false);
    const bool malformed = error.category() == make_error_code(http::error::bad_version).category();
    if (malformed && error != http::error::end_of_stream && error != http::error::partial_message)
        return send({400, "text/plain", "not a request of HTTP/1.1\n", false, 0}, 11, false, false);
    server_.drop(shared_from_this());  // gone, or too slow
}

void HttpServer::Impl::Connection::answer(const Request& request) {
    const bool head = request.method() == http::verb::head;
    const unsigned version = request.version();
    const bool keep = request.keep_alive();
    const auto refuse = [&](int status, const char* why) { send({status, "text/plain", why, false, 0}, version, head, false); };
    if (version != 10 && version != 11) return refuse(505, "HTTP/1.1 is spoken here\n");
    if (!head && request.method() != http::verb::get) return refuse(405, "GET and HEAD are served\n");
    const auto host = request[http::field::host];
    if (version == 11 && host.empty()) return refuse(400, "the request names no Host\n");
    if (!host.empty() && !isOwnName({host.data(), host.size()}))
        return refuse(421, "this host is called localhost; a proxy has to say so too\n");
    SiteAnswer answer = server::answer(server_.board, {request.target().data(), request.target().size()});
    if (!answer.events) return send(std::move(answer), version, head, keep);
    if (head) return send(std::move(answer), version, true, false);
    if (server_.watchers >= server_.config.watchers)
        return refuse(503, "as many pages as there may be follow already; close one\n");
    const auto lastEvent = request["Last-Event-ID"];
    watch(answer.session, {lastEvent.data(), lastEvent.size()});
}

void HttpServer::Impl::Connection::send(SiteAnswer answer, unsigned version, bool head, bool keep) {
    state_ = State::kAnswering;
    response_ = {http::status(answer.status), version};
    secure(response_);
    response_.set(http::field::content_type, answer.type);
    if (answer.status == 405) response_.set(http::field::allow, "GET, HEAD");
    if (answer.status == 503) response_.set(http::field::retry_after, "5");
    response_.keep_alive(keep && !server_.stopping);
    const size_t length = answer.body.size();
    if (!head) response_.body() = std::move(answer.body);
    response_.content_length(length);
    stream_.expires_after(server_.config.patience);
    http::async_write(stream_, response_, [self = shared_from_this()](error_code error, size_t) {
        if (!error && self->response_.keep_alive() && !self->server_.stopping) return self->read();
        error_code ignored;
        self->stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
        self->server_.drop(self);
    });
}

void HttpServer::Impl::Connection::watch(LiveId session, std::string_view lastEvent) {
    state_ = State::kWatching;
    ++server_.watchers;
    asked_ = session;
    if (const auto seen = parseEventId(lastEvent, server_.started)) seen_ = *seen;
    error_code ignored;
    stream_.socket().set_option(net::socket_base::send_buffer_size(kSendBuffer), ignored);
    listen();
    http::response<http::empty_body> head{http::status::ok, 11};
    secure(head);
    head.set(http::field::content_type, "text/event-stream");
    head.set(http::field::connection, "close");
    std::ostringstream text;
    text << head.base() << "retry: 1000\nevent: hello\ndata: " << helloJson(server_.started) << "\n\n";
    push(text.str());
}

/// A watcher has nothing more to say: whatever comes is left unread, and its end is noticed.
void HttpServer::Impl::Connection::listen() {
    stream_.expires_never();
    stream_.async_read_some(net::buffer(ignored_), [self = shared_from_this()](error_code error, size_t) {
        if (!error) return self->listen();
        self->close();
        self->server_.drop(self);
    });
}

/// While an event is on its way nothing is made for the watcher; the board remembers for it.
void HttpServer::Impl::Connection::tick(const std::vector<LiveName>& sessions) {
    if (writing_) return;
    const LiveId session = asked_ != 0 ? asked_ : sessions.empty() ? 0 : sessions.front().id;
    if (session != seen_.session) seen_ = {session, 0, 0};
    const auto news = server_.board.news(session, seen_.number);
    std::string json = newsJson(sessions, news, seen_);
    if (json != told_) {
        told_ = std::move(json);
        return push("id: " + eventId(server_.started, seen_) + "\nevent: news\ndata: " + told_ + "\n\n");
    }
    if (SteadyClock::now() - toldAt_ >= kHeartbeat) push("event: beat\ndata:\n\n");
}

void HttpServer::Impl::Connection::push(std::string text) {
    event_ = std::move(text);
    toldAt_ = SteadyClock::now();
    writing_ = true;
    stream_.expires_after(server_.config.patience);
    net::async_write(stream_, net::buffer(event_), [self = shared_from_this()](error_code error, size_t) {
        self->writing_ = false;
        if (error) self->close();  // which ends the read, and that drops it
    });
}

void HttpServer::Impl::drop(const std::shared_ptr<Connection>& connection) {
    if (connections.erase(connection) > 0 && connection->watches()) --watchers;
    if (stopping && connections.empty()) last.cancel();
}

void HttpServer::Impl::accept() {
    acceptor.async_accept([this](error_code error, tcp::socket socket) {
        if (stopping) return;
        if (error) {  // no descriptor left, most likely: some will be free again
            pause.expires_after(kAcceptPause);
            pause.async_wait([this](error_code cancelled) {
                if (!cancelled) accept();
            });
            return;
        }
        keepToProcess(socket.native_handle());
        if (connections.size() < config.connections)
            (*connections.insert(std::make_shared<Connection>(*this, std::move(socket))).first)->read();
        accept();
    });
}

void HttpServer::Impl::tick() {
    ticker.expires_after(kTick);
    ticker.async_wait([this](error_code cancelled) {
        if (cancelled) return;
        if (watchers > 0) {
            const std::vector<LiveName> sessions = board.sessions();
            for (const auto& connection : connections)
                if (connection->watches()) connection->tick(sessions);
        }
        tick();
    });
}

void HttpServer::Impl::stop() {
    stopping = true;
    error_code ignored;
    acceptor.close(ignored);
    ticker.cancel();
    pause.cancel();
    for (const auto& connection : connections) connection->finish();
    if (connections.empty()) return;
    last.expires_after(kLastAnswers);
    last.async_wait([this](error_code) {
        for (const auto& connection : connections) connection->close();
    });
}

Result<int> HttpServer::listen(const HttpConfig& config) {
    error_code error;
    const auto address = net::ip::make_address(config.address, error);
    if (error || !address.is_loopback())
        return Error{ErrorCode::kUsage, "HTTP address " + config.address +
                                            ": give 127.0.0.1 or ::1, and for other hosts a proxy with TLS before it"};
    net::io_context io;
    tcp::acceptor acceptor(io);
    const tcp::endpoint endpoint(address, config.port);
    acceptor.open(endpoint.protocol(), error);
    if (!error) keepToProcess(acceptor.native_handle());
    if (!error) acceptor.set_option(net::socket_base::reuse_address(true), error);
    if (!error) acceptor.bind(endpoint, error);
    if (!error) acceptor.listen(net::socket_base::max_listen_connections, error);
    const int socket = error ? -1 : acceptor.release(error);
    if (error)
        return Error{ErrorCode::kIo, "HTTP port " + std::to_string(config.port) + " of " + config.address + ": " +
                                         error.message() + "; give another one, or 0 for any", error.value()};
    return socket;
}

uint16_t HttpServer::portOf(int socket) {
    sockaddr_in6 address{};  // the port lies at the same place in both families
    socklen_t size = sizeof address;
    CHECK(::getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size) == 0);
    return ntohs(address.sin6_port);
}

Result<std::unique_ptr<HttpServer>> HttpServer::start(LiveBoard& board, const HttpConfig& config) {
    const auto socket = config.socket >= 0 ? Result<int>(config.socket) : listen(config);
    if (!socket) return socket.error();
    auto impl = std::make_unique<Impl>(board, config);
    error_code error;
    const bool v6 = net::ip::make_address(config.address, error).is_v6();
    impl->acceptor.assign(v6 ? tcp::v6() : tcp::v4(), socket.value(), error);
    if (error) return Error{ErrorCode::kIo, "HTTP: the socket that was handed over: " + error.message(), error.value()};
    impl->port = impl->acceptor.local_endpoint().port();
    impl->accept();
    impl->tick();
    impl->thread = std::thread([&io = impl->io] { io.run(); });
    return std::unique_ptr<HttpServer>(new HttpServer(std::move(impl)));
}

HttpServer::HttpServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

HttpServer::~HttpServer() {
    net::post(impl_->io, [this] { impl_->stop(); });
    impl_->thread.join();
}

uint16_t HttpServer::port() const { return impl_->port; }

}  // namespace server
