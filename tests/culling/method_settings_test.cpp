// Settings of methods as text: what is written reads back, and what is wrong is named.
#include <gtest/gtest.h>

#include "culling/method_settings.h"
#include "culling/shadow_views.h"

namespace {

using culling::ShadowMethod;

std::vector<std::pair<std::string, std::string>> textOf(const ShadowMethod& method) {
    std::vector<std::pair<std::string, std::string>> text;
    for (const culling::MethodSetting& s : culling::settingsOf(method)) text.push_back({s.name, s.value});
    return text;
}

TEST(MethodSettings, EveryOneReadsBack) {
    std::vector<ShadowMethod> methods = culling::namedMethods();
    methods.front().radii = {0.1, 1.0 / 3, 1e300};
    for (const ShadowMethod& method : methods) {
        ShadowMethod copy{.name = method.name};
        for (const auto& [name, value] : textOf(method)) {
            const auto done = culling::set(copy, name, value);
            ASSERT_TRUE(done) << done.error().what;
        }
        EXPECT_EQ(textOf(copy), textOf(method)) << method.name;
        EXPECT_EQ(copy.radii, method.radii);
        EXPECT_EQ(copy.bias.plane, method.bias.plane);
        EXPECT_EQ(copy.bias.normalOffset, method.bias.normalOffset);
    }
}

TEST(MethodSettings, EachIsAnotherValue) {
    const ShadowMethod plain;
    for (const auto& [name, value] : textOf(plain)) {
        const std::string other = value == "yes" ? "no" : value == "no" ? "yes" : name == "radii" ? "1/2" : value + "1";
        ShadowMethod changed;
        if (!culling::set(changed, name, other)) continue;  // one of some names
        size_t differing = 0;
        for (size_t i = 0; i < textOf(plain).size(); ++i) differing += textOf(plain)[i] != textOf(changed)[i];
        EXPECT_EQ(differing, 1u) << name;
    }
}

TEST(MethodSettings, VariantsOfNamedMethods) {
    const auto variant = culling::methodFrom("gnomon:filter=box3:side=2048");
    ASSERT_TRUE(variant) << variant.error().what;
    EXPECT_EQ(variant.value().name, "gnomon:filter=box3:side=2048");
    EXPECT_EQ(variant.value().filter, culling::Filter::kBox3);
    EXPECT_EQ(variant.value().side, 2048);
    EXPECT_EQ(variant.value().keep, culling::Keep::kCached);
}

TEST(MethodSettings, ErrorsNameWhatIsWrongAndTheNearest) {
    const std::pair<const char*, const char*> wrong[] = {{"gnomn", "the nearest is gnomon"},
                                                         {"gnomon:filtr=box3", "the nearest is filter"},
                                                         {"gnomon:filter=box4", "one of none, box2, box3"},
                                                         {"gnomon:side=big", "a whole number"},
                                                         {"gnomon:side=2048.5", "a whole number"},
                                                         {"gnomon:atlas=true", "yes or no"},
                                                         {"gnomon:blend=nan", "0 to less than 1"},
                                                         {"gnomon:radii=1/x", "numbers with /"},
                                                         {"gnomon:side", "SETTING=VALUE"},
                                                         {"gnomon:side=7", "64 to 8192"}};
    for (const auto& [text, says] : wrong) {
        const auto method = culling::methodFrom(text);
        ASSERT_FALSE(method) << text;
        EXPECT_EQ(method.error().code, world::ErrorCode::kUsage);
        EXPECT_NE(method.error().what.find(says), std::string::npos) << method.error().what;
    }
}

}  // namespace
