// server/live_site.h — what each address of the HTTP port answers.
#pragma once

#include <string>
#include <string_view>

#include "server/live_board.h"

namespace server {

struct SiteAnswer {
    int status = 200;
    std::string type = "text/plain; charset=utf-8";
    std::string body;
    bool events = false;  ///< a stream of events follows instead of the body
    LiveId session = 0;   ///< to be followed; 0: the first that there is
};

/// Answers GET for a target as it stands in a request: a path and perhaps a query. Whatever is in it, some status of
/// HTTP comes back; bodies of errors say in a line what would have been right. Any thread.
///   /           the live page, which loads /page.css, /page.js, /maps.js, /plan.js, /charts.js and /chart.js
///   /events     news as server-sent events; ?session=ID
///   /map        a picture of a map; ?session=ID&cascade=N
///   /healthz    200 while the process answers     /readyz  200 while it takes sessions, else 503
///   /metrics    for Prometheus
SiteAnswer answer(LiveBoard& board, std::string_view target);

}  // namespace server
