// world/dem.cpp — see dem.h.
#include "world/dem.h"

#include <cpl_error.h>
#include <cpl_json.h>
#include <cpl_vsi.h>
#include <gdal_priv.h>
#include <ogr_spatialref.h>

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <span>

#include "world/hash.h"
#include "world/heights.h"
#include "world/terrain.h"

namespace world {
namespace {

constexpr int32_t kDefaultSide = 64, kLeastSide = 8, kMostSide = 256;  // chunk edges [voxels]
constexpr int64_t kMostCells = 1'000'000'000;                          // 4 GB of heights
constexpr int kRowsAtOnce = 256;

/// Catches what GDAL would print, as one line, while it lives.
class GdalErrors {
public:
    GdalErrors() : pusher_(&GdalErrors::handle, this) { CPLErrorReset(); }
    GdalErrors(const GdalErrors&) = delete;
    GdalErrors& operator=(const GdalErrors&) = delete;

    /// ": " and the first failure, or nothing.
    std::string why() const { return first_.empty() ? "" : ": " + first_; }

private:
    static void CPL_STDCALL handle(CPLErr level, CPLErrorNum, const char* text) {
        auto* self = static_cast<GdalErrors*>(CPLGetErrorHandlerUserData());
        if (level < CE_Failure || !self->first_.empty()) return;
        self->first_ = text;
        std::replace(self->first_.begin(), self->first_.end(), '\n', ' ');
    }
    std::string first_;
    CPLErrorHandlerPusher pusher_;
};

Error bad(const std::string& path, const std::string& what) {
    return {ErrorCode::kBadData, path + ": " + what};
}

std::string number(double v) {
    char text[32];
    std::snprintf(text, sizeof text, "%.10g", v);
    return text;
}

/// The raster's place on the map: x = left + column * dx, northing = top + row * dn at cell corners.
struct Georeference {
    double left = 0, top = 0, dx = 0, dn = 0;
};

Result<Georeference> georeference(const std::string& path, GDALDataset& data,
                                  std::vector<std::string>& warnings) {
    const std::string warp = "gdalwarp -r bilinear -t_srs EPSG:";
    double g[6];
    if (data.GetGeoTransform(g) != CE_None) {
        return bad(path,
                   "has no place on the map (no geotransform); give it one with gdal_translate -a_srs "
                   "EPSG:... -a_ullr XMIN YMAX XMAX YMIN IN OUT");
    }
    const double centreX = g[0] + g[1] * data.GetRasterXSize() / 2,
                 centreY = g[3] + g[5] * data.GetRasterYSize() / 2;
    const auto zone = [&] {  // the UTM zone of the middle, which gdalwarp can be told
        const int n = std::clamp(static_cast<int>(std::floor((centreX + 180) / 6)) + 1, 1, 60);
        return std::to_string((centreY < 0 ? 32700 : 32600) + n);
    };
    const OGRSpatialReference* crs = data.GetSpatialRef();
    if (crs && crs->IsGeographic()) {
        return bad(path, "its coordinates are degrees; project it: " + warp + zone() + " IN OUT");
    }
    if (crs && crs->IsGeocentric())
        return bad(path, "its coordinates are geocentric; project it: " + warp + "... IN OUT");
    if (crs) {
        const char* unit = nullptr;
        const double metres = crs->GetLinearUnits(&unit);
        if (std::abs(metres - 1) > 1e-9) {
            return bad(path, std::string("its coordinates are in ") + (unit ? unit : "an unknown unit") +
                                 ", not metres; project it: " + warp + "... IN OUT");
        }
    }
    if (g[2] != 0 || g[4] != 0) {
        return bad(path,
                   "its grid is turned or sheared against the map; turn it north up: " + warp + "... IN OUT");
    }
    for (const double v : g) {
        if (!std::isfinite(v))
            return bad(path, "its geotransform is not finite; set it with gdal_edit.py -a_ullr");
    }
    if (!(g[1] > 0) || g[5] == 0)
        return bad(path, "its cells have no size; set it with gdal_edit.py -a_ullr");
    if (!crs) {
        if (std::abs(centreX) <= 360 && std::abs(centreY) <= 90 && g[1] < 0.05) {
            return bad(path, "has no coordinate system and looks like degrees; project it: " + warp + zone() +
                                 " -s_srs EPSG:4326 IN OUT");
        }
        warnings.push_back(path + ": has no coordinate system; its coordinates are taken as metres");
    }
    return Georeference{g[0], g[3], g[1], g[5]};
}

/// Columns and rows [first, end) of the raster.
struct Window {
    int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
};

Result<Window> window(const std::string& path, GDALDataset& data, const Georeference& geo,
                      const std::optional<std::array<double, 4>>& bounds) {
    Window w{0, 0, data.GetRasterXSize(), data.GetRasterYSize()};
    if (bounds) {
        const auto [xmin, ymin, xmax, ymax] = *bounds;
        const double right = geo.left + geo.dx * w.x1, end = geo.top + geo.dn * w.y1;
        const double low = std::min(geo.top, end), high = std::max(geo.top, end);
        const auto extent = [](double a, double b, double c, double d) {
            return number(a) + "," + number(b) + "," + number(c) + "," + number(d);
        };
        if (!(xmin < xmax && ymin < ymax)) {
            return Error{ErrorCode::kUsage, "bounds " + extent(xmin, ymin, xmax, ymax) +
                                                ": give XMIN,YMIN,XMAX,YMAX with the smaller numbers first"};
        }
        if (xmin >= right || xmax <= geo.left || ymin >= high || ymax <= low) {
            return Error{ErrorCode::kUsage, "bounds " + extent(xmin, ymin, xmax, ymax) + " lie off " + path +
                                                ", which covers " + extent(geo.left, low, right, high)};
        }
        const auto cells = [](double a, double b, double origin, double step, int& first, int& last) {
            const double p = (a - origin) / step, q = (b - origin) / step;
            first = static_cast<int>(std::max(double(first), std::floor(std::min(p, q))));
            last = static_cast<int>(std::min(double(last), std::ceil(std::max(p, q))));
        };
        cells(xmin, xmax, geo.left, geo.dx, w.x0, w.x1);
        cells(ymin, ymax, geo.top, geo.dn, w.y0, w.y1);
    }
    if (int64_t{w.x1 - w.x0} * (w.y1 - w.y0) > kMostCells) {
        return Error{ErrorCode::kLimit, path + ": " + std::to_string(w.x1 - w.x0) + " x " +
                                            std::to_string(w.y1 - w.y0) + " cells are more than " +
                                            std::to_string(kMostCells) + "; bake a part of it with bounds"};
    }
    return w;
}

/// Reads the window's heights, voids as NaN.
Result<Heights> readHeights(const std::string& path, GDALDataset& data, const Georeference& geo,
                            const Window& w, const GdalErrors& errors) {
    GDALRasterBand* band = data.GetRasterBand(1);
    if (!band || GDALDataTypeIsComplex(band->GetRasterDataType())) {
        return bad(path, "its first band holds no heights; select the band with gdal_translate -b");
    }
    const std::string unit = band->GetUnitType();
    if (unit != "" && unit != "m" && unit != "metre" && unit != "meter" && unit != "metres" &&
        unit != "meters") {
        return bad(path,
                   "its heights are in " + unit + ", not metres; convert them with gdal_calc.py --calc");
    }
    int declared = 0;
    const double noData = band->GetNoDataValue(&declared);
    // As the reader rounds it; a value that floats cannot hold (the lowest double) is their own limit.
    const auto none =
        declared ? static_cast<float>(std::clamp(noData, -double{FLT_MAX}, double{FLT_MAX})) : -9999.0f;
    const double scale = band->GetScale(), offset = band->GetOffset();

    Heights h;
    h.columns = w.x1 - w.x0;
    h.rows = w.y1 - w.y0;
    h.x0 = geo.left + (w.x0 + 0.5) * geo.dx;
    h.z0 = -(geo.top + (w.y0 + 0.5) * geo.dn);
    h.dx = geo.dx;
    h.dz = -geo.dn;
    h.values.resize(static_cast<size_t>(int64_t{h.columns} * h.rows));
    for (int32_t row = 0; row < h.rows; row += kRowsAtOnce) {
        const int32_t count = std::min(kRowsAtOnce, h.rows - row);
        float* to = h.values.data() + int64_t{row} * h.columns;
        if (band->RasterIO(GF_Read, w.x0, w.y0 + row, h.columns, count, to, h.columns, count, GDT_Float32, 0,
                           0, nullptr) != CE_None) {
            return bad(path, "rows " + std::to_string(w.y0 + row) + " to " +
                                 std::to_string(w.y0 + row + count - 1) + " cannot be read" + errors.why() +
                                 "; fetch the file again");
        }
    }
    for (float& v : h.values) {
        if (v == none || !std::isfinite(v)) {
            v = NAN;
        } else if (scale != 1 || offset != 0) {
            v = static_cast<float>(v * scale + offset);
        }
    }
    return h;
}

/// `sun_direction` of a scene.json beside the file; zero without one.
Result<glm::dvec3> sunBeside(const std::string& path) {
    const std::string file = (std::filesystem::path(path).parent_path() / "scene.json").string();
    VSIStatBufL status;
    if (VSIStatL(file.c_str(), &status) != 0) return glm::dvec3(0);
    CPLJSONDocument document;
    if (!document.Load(file)) return bad(file, "is no JSON; mend it or move it away");
    const CPLJSONObject entry = document.GetRoot().GetObj("sun_direction");
    if (!entry.IsValid()) return glm::dvec3(0);
    const CPLJSONArray list = entry.ToArray();
    glm::dvec3 sun(0);
    if (list.IsValid() && list.Size() == 3) {
        for (int i = 0; i < 3; ++i) sun[i] = list[i].ToDouble(NAN);
    }
    const double length = glm::length(sun);
    if (!(length > 0) || !std::isfinite(length))
        return bad(file, "sun_direction is no direction of three numbers");
    return sun / length;
}

struct Lattice {
    double chunkSize = 0, voxel = 0;
    int32_t side = 0;
};

Result<Lattice> latticeFor(const DemOptions& options, double posting) {
    const auto usage = [](const std::string& what) { return Error{ErrorCode::kUsage, what}; };
    const auto sane = [](double v) { return std::isfinite(v) && v >= 0; };
    if (!sane(options.chunkSize) || !sane(options.voxel))
        return usage("chunk and voxel must be metres above zero");
    Lattice lattice{options.chunkSize, options.voxel, 0};
    if (lattice.voxel == 0) {
        lattice.voxel = posting;
        if (lattice.chunkSize > 0)
            lattice.voxel = lattice.chunkSize / std::max(1.0, std::round(lattice.chunkSize / posting));
    }
    if (lattice.chunkSize == 0) lattice.chunkSize = kDefaultSide * lattice.voxel;
    const double voxels = lattice.chunkSize / lattice.voxel;
    if (!(voxels > kLeastSide - 0.5 && voxels < kMostSide + 0.5) ||
        std::abs(voxels - std::round(voxels)) > 1e-9 * voxels) {
        return usage("a chunk of " + number(lattice.chunkSize) + " m is " + number(voxels) + " voxels of " +
                     number(lattice.voxel) + " m wide; choose 8 to 256 whole voxels");
    }
    lattice.side = static_cast<int32_t>(std::lround(voxels));
    return lattice;
}

}  // namespace

Result<BakeSource> openDem(const std::string& path, const DemOptions& options) {
    VSIStatBufL status;
    if (VSIStatL(path.c_str(), &status) != 0) return Error{ErrorCode::kNotFound, path + ": no such file; check the name"};
    GDALAllRegister();
    const GdalErrors errors;
    const std::unique_ptr<GDALDataset> data(
        GDALDataset::Open(path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY | GDAL_OF_VERBOSE_ERROR));
    if (!data || data->GetRasterCount() == 0) {
        return bad(path, "is no raster that GDAL can read" + errors.why() + "; see gdalinfo --formats");
    }

    BakeSource source;
    const Result<Georeference> geo = georeference(path, *data, source.warnings);
    if (!geo) return geo.error();
    const Result<Lattice> lattice = latticeFor(options, std::min(geo.value().dx, std::abs(geo.value().dn)));
    if (!lattice) return lattice.error();
    const Result<Window> part = window(path, *data, geo.value(), options.bounds);
    if (!part) return part.error();
    Result<Heights> read = readHeights(path, *data, geo.value(), part.value(), errors);
    if (!read) return read.error();
    const Result<glm::dvec3> sun =
        options.sun ? Result<glm::dvec3>(glm::normalize(*options.sun)) : sunBeside(path);
    if (!sun) return sun.error();

    const auto heights = std::make_shared<Heights>(std::move(read.value()));
    if (const int64_t mended = mendHeights(*heights); mended > 0) {
        source.warnings.push_back(
            path + ": " + std::to_string(mended) + " of " + std::to_string(heights->values.size()) +
            " cells hold heights that no terrain has; each took the median of its neighbours");
    }

    const auto [chunkSize, voxel, side] = lattice.value();
    const double z1 = heights->z0 + heights->dz * (heights->rows - 1),
                 x1 = heights->x0 + heights->dx * (heights->columns - 1);
    const auto cell = [&](double v) { return std::floor(v / chunkSize); };
    const double firstX = cell(heights->x0), lastX = cell(x1), firstZ = cell(std::min(heights->z0, z1)),
                 lastZ = cell(std::max(heights->z0, z1));
    constexpr double kFarthest = 1 << 30;
    if (std::max({std::abs(firstX), std::abs(lastX), std::abs(firstZ), std::abs(lastZ)}) > kFarthest) {
        return Error{ErrorCode::kUsage, path + ": chunks of " + number(chunkSize) +
                                            " m are too small to count so far out; choose larger ones"};
    }
    for (auto x = static_cast<int32_t>(firstX); x <= static_cast<int32_t>(lastX); ++x) {
        for (auto z = static_cast<int32_t>(firstZ); z <= static_cast<int32_t>(lastZ); ++z) {
            if (anyGround(*heights, x * chunkSize, z * chunkSize, (x + 1.0) * chunkSize,
                          (z + 1.0) * chunkSize)) {
                source.chunks.push_back({x, 0, z});
            }
        }
    }
    if (source.chunks.empty())
        return bad(path, "no heights there: every cell is no-data; choose other bounds");

    const double place[] = {heights->x0, heights->z0, heights->dx, heights->dz, double(heights->columns)};
    source.contents =
        hashValues(std::span<const float>(heights->values), hashValues(std::span<const double>(place)));
    source.header.chunkSize = chunkSize;
    source.header.voxel = voxel;
    source.header.sun = sun.value();
    source.header.source = std::filesystem::path(path).filename().string();
    source.make = [heights, side, voxel](ChunkKey key) -> Result<SourceChunk> {
        Result<std::optional<TerrainChunk>> terrain = makeTerrain(fieldOf(*heights), key, side, voxel);
        if (!terrain) return terrain.error();
        SourceChunk chunk;
        chunk.terrain = std::move(terrain.value());
        return chunk;
    };
    return source;
}

}  // namespace world
