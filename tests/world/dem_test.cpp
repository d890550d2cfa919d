// tests/world/dem_test.cpp — rasters of heights: met post by post, and refused with a remedy.
#include "world/dem.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <random>
#include <sstream>

#include "world/heights.h"

namespace world {
namespace {

namespace fs = std::filesystem;

const fs::path kBenalla = fs::path(GNOMON_SOURCE_DIR) / "../shared/data/benalla/dem.tif";

/// A folder of its own that is gone afterwards.
class Dem : public testing::Test {
protected:
    void SetUp() override {
        folder_ =
            fs::temp_directory_path() / ("gnomon_dem_" + std::to_string(reinterpret_cast<uintptr_t>(this)) +
                                         "_" + testing::UnitTest::GetInstance()->current_test_info()->name());
        fs::create_directories(folder_);
    }
    void TearDown() override { fs::remove_all(folder_); }

    std::string write(const std::string& name, const std::string& text) const {
        std::ofstream(folder_ / name, std::ios::binary) << text;
        return (folder_ / name).string();
    }

    /// An ESRI ASCII grid of 10 m cells with its lower left corner at (500000, 6000000), UTM 55 south.
    template <class F>
    std::string grid(int columns, int rows, F height) const {
        write(
            "dem.prj",
            "PROJCS[\"WGS 84 / UTM zone 55S\",GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS "
            "84\",6378137,298.257223563]],PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]],"
            "PROJECTION[\"Transverse_Mercator\"],PARAMETER[\"latitude_of_origin\",0],"
            "PARAMETER[\"central_meridian\",147],PARAMETER[\"scale_factor\",0.9996],"
            "PARAMETER[\"false_easting\",500000],PARAMETER[\"false_northing\",10000000],UNIT[\"metre\",1]]");
        std::ostringstream text;
        text << "ncols " << columns << "\nnrows " << rows
             << "\nxllcorner 500000\nyllcorner 6000000\ncellsize 10\nNODATA_value -32768\n";
        for (int r = 0; r < rows; ++r) {
            for (int c = 0; c < columns; ++c) {
                text << height(500000 + (c + 0.5) * 10, 6000000 + (rows - r - 0.5) * 10)
                     << (c + 1 < columns ? " " : "\n");
            }
        }
        return write("dem.asc", text.str());
    }

    fs::path folder_;
};

/// Vertices of level 0 in the world's frame, skirts left out by the caller's own means.
template <class F>
void forVertices(const BakeSource& source, F visit) {
    for (const ChunkKey& key : source.chunks) {
        const Result<SourceChunk> chunk = source.make(key);
        ASSERT_TRUE(chunk);
        if (!chunk.value().terrain) continue;
        const glm::dvec3 origin = glm::dvec3(key.x, 0, key.z) * source.header.chunkSize;
        for (const glm::vec3& p : chunk.value().terrain->mesh.levels[0].positions)
            visit(origin + glm::dvec3(p));
    }
}

TEST_F(Dem, APlaneIsMetExactlyInFullCoordinates) {
    const auto plane = [](double e, double n) { return 200 + 0.1 * (e - 500000) + 0.2 * (n - 6000000); };
    Result<BakeSource> source = openDem(grid(100, 80, plane), {.chunkSize = 320});
    ASSERT_TRUE(source) << source.error().what;
    EXPECT_EQ(source.value().header.voxel, 10);
    EXPECT_EQ(source.value().header.chunkSize, 320);
    EXPECT_EQ(source.value().header.sun, glm::dvec3(0));
    EXPECT_EQ(source.value().header.source, "dem.asc");
    EXPECT_TRUE(source.value().warnings.empty());
    EXPECT_TRUE(std::is_sorted(source.value().chunks.begin(), source.value().chunks.end()));
    Box reach;
    size_t onPlane = 0, below = 0;
    forVertices(source.value(), [&](glm::dvec3 p) {
        const double off = (p.y - plane(p.x, -p.z)) / std::sqrt(1 + 0.01 + 0.04);
        if (off < -5) {
            ++below;  // a skirt
            return;
        }
        ++onPlane;
        // Distances are stored in steps of 30 m / 32767, floats in the chunk's frame hold 0.1 mm.
        ASSERT_NEAR(off, 0, 0.002);
        reach.add(p);
    });
    EXPECT_GT(onPlane, 7000u);
    EXPECT_GT(below, 100u);
    // Ends within a post and a half of the outermost posts.
    EXPECT_NEAR(reach.min.x, 500005, 15);
    EXPECT_NEAR(reach.max.x, 500995, 15);
    EXPECT_NEAR(reach.min.z, -6000795, 15);
    EXPECT_NEAR(reach.max.z, -6000005, 15);
}

TEST_F(Dem, BoundsCutAndMissTheRaster) {
    const std::string path = grid(100, 80, [](double, double) { return 50; });
    Result<BakeSource> part =
        openDem(path, {.bounds = {{500400, 6000300, 500700, 6009999}}, .chunkSize = 80});
    ASSERT_TRUE(part) << part.error().what;
    Box reach;
    forVertices(part.value(), [&](glm::dvec3 p) { reach.add(p); });
    EXPECT_NEAR(reach.min.x, 500405, 15);
    EXPECT_NEAR(reach.max.x, 500695, 15);
    EXPECT_NEAR(reach.max.z, -6000305, 15);
    EXPECT_NEAR(reach.min.z, -6000795, 15);

    const Result<BakeSource> off = openDem(path, {.bounds = {{0, 0, 1000, 1000}}});
    ASSERT_FALSE(off);
    EXPECT_EQ(off.error().code, ErrorCode::kUsage);
    EXPECT_NE(off.error().what.find("0,0,1000,1000"), std::string::npos);
    EXPECT_NE(off.error().what.find("500000,6000000,501000,6000800"), std::string::npos);
    const Result<BakeSource> turned = openDem(path, {.bounds = {{500700, 6000300, 500400, 6009999}}});
    ASSERT_FALSE(turned);
    EXPECT_EQ(turned.error().code, ErrorCode::kUsage);
}

TEST_F(Dem, SamplesBetweenThePosts) {
    const auto plane = [](double e, double) { return 0.3 * (e - 500000); };
    Result<BakeSource> source = openDem(grid(64, 64, plane), {.voxel = 4});
    ASSERT_TRUE(source) << source.error().what;
    EXPECT_EQ(source.value().header.chunkSize, 256);
    forVertices(source.value(), [&](glm::dvec3 p) {
        const double off = p.y - plane(p.x, 0);
        if (off > -2) {
            ASSERT_NEAR(off, 0, 0.002);
        }
    });
    EXPECT_FALSE(openDem(grid(64, 64, plane), {.chunkSize = 250, .voxel = 4}));
    EXPECT_FALSE(openDem(grid(64, 64, plane), {.chunkSize = 16, .voxel = 4}));
    EXPECT_FALSE(openDem(grid(64, 64, plane), {.voxel = -1}));
    EXPECT_FALSE(openDem(grid(64, 64, plane), {.voxel = NAN}));
}

TEST_F(Dem, VoidsHaveNoTerrain) {
    const auto hole = [](double e, double n) {
        return std::hypot(e - 500320, n - 6000320) < 100 ? -32768 : 80;
    };
    Result<BakeSource> source = openDem(grid(64, 64, hole), {});
    ASSERT_TRUE(source);
    EXPECT_TRUE(source.value().warnings.empty());
    forVertices(source.value(), [&](glm::dvec3 p) {
        ASSERT_GT(std::hypot(p.x - 500320, p.z + 6000320), 90) << "terrain where nothing is known";
        ASSERT_GT(p.y, -1000);
    });
    const Result<BakeSource> none = openDem(grid(64, 64, [](double, double) { return -32768; }), {});
    ASSERT_FALSE(none);
    EXPECT_EQ(none.error().code, ErrorCode::kBadData);
}

TEST_F(Dem, GarbageIsMendedAndCounted) {
    const auto spiked = [](double e, double n) {
        if (e == 500205 && n == 6000205) return 60000.0;
        if (e == 500405 && n == 6000205) return -5000.0;
        if (e == 500415 && n == 6000205) return -5000.0;  // two side by side
        return 100.0;
    };
    Result<BakeSource> source = openDem(grid(64, 64, spiked), {});
    ASSERT_TRUE(source);
    ASSERT_EQ(source.value().warnings.size(), 1u);
    EXPECT_NE(source.value().warnings[0].find("3 of 4096 cells"), std::string::npos)
        << source.value().warnings[0];
    forVertices(source.value(), [&](glm::dvec3 p) {
        ASSERT_LT(p.y, 101);
        ASSERT_GT(p.y, 100 - 120);  // skirts
    });
}

TEST(Heights, MendingLeavesRealCliffsAlone) {
    std::mt19937 rng(5);
    Heights h{.x0 = 0, .z0 = 0, .dx = 90, .dz = 90, .columns = 40, .rows = 30, .values = {}};
    for (int i = 0; i < 40 * 30; ++i) h.values.push_back(float(i % 40 > 20 ? 900 : 0) + float(rng() % 50));
    const std::vector<float> before = h.values;
    EXPECT_EQ(mendHeights(h), 0);
    EXPECT_EQ(h.values, before);
    // Each spoiled cell alone comes back near its neighbours.
    for (int n = 0; n < 200; ++n) {
        h.values = before;
        const size_t cell = rng() % before.size();
        h.values[cell] = n % 2 ? 2500.0f + float(rng() % 50000) : -1500.0f - float(rng() % 50000);
        EXPECT_EQ(mendHeights(h), 1) << "cell " << cell;
        EXPECT_GE(h.values[cell], 0);
        EXPECT_LE(h.values[cell], 950);
    }
}

TEST(Heights, BilinearBetweenPostsAndVoidBesideVoids) {
    Heights h{
        .x0 = 1e6, .z0 = -6e6, .dx = 2, .dz = -3, .columns = 3, .rows = 2, .values = {0, 2, 4, 6, 8, NAN}};
    EXPECT_EQ(h.between(1e6, -6e6), 0);
    EXPECT_EQ(h.between(1e6 + 4, -6e6), 4) << "on a post, the void beside it does not matter";
    EXPECT_DOUBLE_EQ(h.between(1e6 + 1, -6e6 - 1.5), 4);
    EXPECT_TRUE(std::isnan(h.between(1e6 + 3, -6e6 - 1)));
    EXPECT_TRUE(std::isnan(h.between(1e6 - 0.5, -6e6)));
    EXPECT_TRUE(std::isnan(h.between(NAN, 0)));
}

// ---- refusals ----

std::string vrt(const std::string& georeference) {
    return "<VRTDataset rasterXSize=\"64\" rasterYSize=\"64\">" + georeference +
           "<VRTRasterBand dataType=\"Float32\" band=\"1\"><SimpleSource><SourceFilename "
           "relativeToVRT=\"1\">dem.asc"
           "</SourceFilename><SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>";
}

TEST_F(Dem, RefusesWhatIsNotInMetresOnTheMap) {
    grid(64, 64, [](double, double) { return 5; });
    const struct {
        const char* georeference;
        const char* remedy;
    } cases[] = {
        {"", "gdal_translate"},
        {"<SRS>EPSG:4326</SRS><GeoTransform>146.5,0.001,0,-36.2,0,-0.001</GeoTransform>", "EPSG:32755"},
        {"<GeoTransform>7.5,0.001,0,46.2,0,-0.001</GeoTransform>", "EPSG:32632"},
        {"<SRS>EPSG:32755</SRS><GeoTransform>500000,9,1,6000000,1,-9</GeoTransform>", "gdalwarp"},
        {"<SRS>EPSG:2227</SRS><GeoTransform>6000000,10,0,2000000,0,-10</GeoTransform>", "gdalwarp"},
    };
    for (const auto& c : cases) {
        const Result<BakeSource> refused = openDem(write("dem.vrt", vrt(c.georeference)), {});
        ASSERT_FALSE(refused) << c.georeference;
        EXPECT_EQ(refused.error().code, ErrorCode::kBadData);
        EXPECT_NE(refused.error().what.find(c.remedy), std::string::npos) << refused.error().what;
        EXPECT_EQ(refused.error().what.find('\n'), std::string::npos);
    }
    const Result<BakeSource> fine =
        openDem(write("dem.vrt", vrt("<GeoTransform>500000,10,0,6000000,0,-10</GeoTransform>")), {});
    ASSERT_TRUE(fine) << fine.error().what;
    EXPECT_EQ(fine.value().warnings.size(), 1u) << "no coordinate system: said, not refused";
}

TEST_F(Dem, RefusesMissingForeignAndTruncatedFiles) {
    EXPECT_EQ(openDem((folder_ / "none.tif").string(), {}).error().code, ErrorCode::kNotFound);
    for (const char* text : {"", "hello", "II*\0garbage"}) {
        const Result<BakeSource> refused = openDem(write("foreign.tif", text), {});
        ASSERT_FALSE(refused);
        EXPECT_EQ(refused.error().code, ErrorCode::kBadData);
    }
    const std::string path = grid(9, 9, [](double e, double) { return int(e) % 97; });
    std::stringstream whole;
    whole << std::ifstream(path).rdbuf();
    // The last byte is the line's end, the one before it may be half a number: both are read whole.
    for (size_t n = 0; n + 3 < whole.str().size(); ++n) {
        const Result<BakeSource> refused = openDem(write("dem.asc", whole.str().substr(0, n)), {});
        ASSERT_FALSE(refused) << n << " of " << whole.str().size() << " bytes";
    }
}

TEST_F(Dem, TruncatedGeoTiffSaysWhichRows) {
    if (!fs::exists(kBenalla)) GTEST_SKIP() << "no ../shared";
    std::ifstream in(kBenalla, std::ios::binary);
    std::string whole(size_t(fs::file_size(kBenalla)), '\0');
    in.read(whole.data(), std::streamsize(whole.size()));
    for (const double share : {0.0, 0.001, 0.1, 0.5, 0.9, 0.999}) {
        const Result<BakeSource> refused =
            openDem(write("cut.tif", whole.substr(0, size_t(share * double(whole.size())))), {});
        ASSERT_FALSE(refused) << share;
        EXPECT_EQ(refused.error().code, ErrorCode::kBadData);
        EXPECT_EQ(refused.error().what.find('\n'), std::string::npos);
    }
}

TEST_F(Dem, SunComesFromTheSceneBesideTheFile) {
    const std::string path = grid(64, 64, [](double, double) { return 5; });
    write("scene.json", "{\"sun_direction\": [0, -2, 0]}");
    EXPECT_EQ(openDem(path, {}).value().header.sun, glm::dvec3(0, -1, 0));
    EXPECT_EQ(openDem(path, {.sun = glm::dvec3(1, 0, 0)}).value().header.sun, glm::dvec3(1, 0, 0));
    for (const char* broken :
         {"{\"sun_direction\": [0, 0, 0]}", "{\"sun_direction\": \"up\"}", "{\"sun_direction"}) {
        write("scene.json", broken);
        EXPECT_FALSE(openDem(path, {})) << broken;
    }
}

TEST(DemBenalla, IsBakedWhereItLies) {
    if (!fs::exists(kBenalla)) GTEST_SKIP() << "no ../shared";
    // 18 km around the Benalla airfield's hills: nine chunks at most.
    Result<BakeSource> source = openDem(kBenalla.string(), {.bounds = {{420000, 5940000, 432000, 5952000}}});
    ASSERT_TRUE(source) << source.error().what;
    EXPECT_EQ(source.value().header.voxel, 90);
    EXPECT_EQ(source.value().header.chunkSize, 5760);
    EXPECT_NEAR(glm::length(source.value().header.sun), 1, 1e-12);
    EXPECT_NEAR(source.value().header.sun.y, -0.946394, 1e-5);
    ASSERT_FALSE(source.value().chunks.empty());
    double lowest = 1e9, highest = -1e9;
    size_t triangles = 0;
    for (const ChunkKey& key : source.value().chunks) {
        const Result<SourceChunk> chunk = source.value().make(key);
        ASSERT_TRUE(chunk);
        if (!chunk.value().terrain) continue;
        const Mesh& mesh = chunk.value().terrain->mesh;
        triangles += mesh.levels[0].indices.size() / 3;
        for (const glm::vec3& p : mesh.levels[0].positions) {
            lowest = std::min(lowest, double(p.y));
            highest = std::max(highest, double(p.y));
        }
        for (size_t i = 1; i < mesh.levels.size(); ++i)
            EXPECT_GT(mesh.levels[i].error, mesh.levels[i - 1].error);
    }
    EXPECT_GT(triangles, 30000u);
    EXPECT_GT(lowest, 58 - 560) << "the lowest post less the deepest skirt";
    EXPECT_LT(highest, 1977 + 1);
}

}  // namespace
}  // namespace world
