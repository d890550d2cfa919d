#include "server/live_json.h"

#include <nlohmann/json.hpp>

namespace server {
namespace {

using Json = nlohmann::ordered_json;

std::string dump(const Json& json) { return json.dump(-1, ' ', false, Json::error_handler_t::replace); }

Json jsonOf(const LiveName& name) {
    return {{"id", name.id}, {"name", name.name}, {"world", name.world}, {"frames", name.frames}};
}

Json jsonOf(const LiveFrame& f) {
    Json texels = Json::array(), triangles = Json::array();
    for (const cache::Cost& cost : f.byCause) {
        texels.push_back(cost.texels);
        triangles.push_back(cost.triangles);
    }
    texels.push_back(f.active.texels);
    triangles.push_back(f.active.triangles);
    return {{"n", f.number}, {"frame", f.frame}, {"t", f.time}, {"ms", f.ms}, {"gpu", f.gpuMs}, {"texels", texels},
            {"triangles", triangles}, {"resident", f.residentBytes}, {"geometry", f.geometryBytes},
            {"missing", f.missingChunks}, {"coarse", f.coarseChunks}, {"unknown", f.unknownTexels},
            {"stale", f.staleTexels}, {"eye", {f.eye.x, f.eye.y, f.eye.z}}, {"ahead", {f.heading.x, f.heading.y}}};
}

}  // namespace

std::string helloJson(int64_t started) {
    Json causes = Json::array();
    for (int c = 0; c < cache::kCauses; ++c) causes.push_back(cache::toString(cache::Cause(c)));
    return dump({{"started", started}, {"causes", causes}});
}

std::string newsJson(const std::vector<LiveName>& sessions, const std::optional<LiveNews>& news, LiveSeen& seen) {
    Json json{{"sessions", Json::array()}, {"session", nullptr}};
    for (const LiveName& name : sessions) json["sessions"].push_back(jsonOf(name));
    if (!news) return dump(json);
    json["session"] = jsonOf(news->session);
    json["side"] = news->side;
    json["lost"] = news->lost;
    json["errors"] = {{"count", news->errorCount}, {"last", news->errors}};
    Json &frames = json["frames"] = Json::array(), &marks = json["marks"] = Json::array(),
         &cascades = json["cascades"] = Json::array();
    for (const LiveFrame& f : news->frames) frames.push_back(jsonOf(f));
    for (const LiveMark& m : news->marks) {
        const cache::Texel size = m.rect.max - m.rect.min;
        marks.push_back({m.number, m.cascade, m.cause ? int(*m.cause) : -1, m.rect.min.x, m.rect.min.y, size.x, size.y});
    }
    for (size_t k = 0; k < news->cascades.size(); ++k) {
        const LiveCascade& c = news->cascades[k];
        cascades.push_back({{"camera", c.camera}, {"texel", c.texel}, {"split", c.split}, {"x", c.window.x},
                            {"y", c.window.y}, {"drawn", c.drawn}, {"asleep", c.asleep}, {"unknown", c.unknownTexels},
                            {"stale", c.staleTexels}, {"missing", c.missingTexels},
                            {"picture", k < news->pictures.size() ? news->pictures[k] : 0}});
    }
    if (news->chunks && news->chunksNumber != seen.chunks) {
        Json places = Json::array();
        for (const ChunkPlace& p : news->chunks->places)
            for (const int value : {p.key.x, p.key.z, int(p.phase)}) places.push_back(value);
        json["chunks"] = {{"n", news->chunksNumber}, {"size", news->chunks->size}, {"away", news->chunks->away},
                          {"places", places}};
        Json settings = Json::array();
        for (const LiveSetting& s : *news->settings) settings.push_back({s.name, s.value});
        json["settings"] = settings;
        seen.chunks = news->chunksNumber;
    }
    seen.number = news->session.frames;
    return dump(json);
}

std::string pictureBody(const LivePicture& p) {
    std::string body = dump({{"n", p.number}, {"x", p.window.x}, {"y", p.window.y}, {"side", p.side}, {"texels", p.texels},
                             {"near", p.near}, {"far", p.far}}) + "\n";
    body.append(p.values.begin(), p.values.end());
    return body;
}

}  // namespace server
