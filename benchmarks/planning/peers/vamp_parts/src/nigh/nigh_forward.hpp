// The nearest node by comparing with each one, under the names of nigh. VAMP has nigh compare up to 128 nodes in this
// way before it divides them; the trees of the measured problems have 14 nodes at the median and 147 at most.
#pragma once
#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

namespace unc::robotics::nigh
{
    namespace metric
    {
        template <int p>
        struct LP;
        template <typename Point, typename Metric>
        struct Space;
    }  // namespace metric

    struct NoThreadSafety;
    template <std::size_t batch>
    struct KDTreeBatch;

    template <typename Node, typename Space, typename Key, typename Threads, typename Strategy>
    class Nigh
    {
        using Point = typename Space::Type;
        using Distance = typename Space::Distance;
        using Near = std::pair<Node, Distance>;

    public:
        void insert(const Node &node)
        {
            nodes_.push_back(node);
        }

        [[nodiscard]] auto size() const -> std::size_t
        {
            return nodes_.size();
        }

        [[nodiscard]] auto nearest(const Point &point) const -> std::optional<Near>
        {
            std::optional<Near> found;
            for (const auto &node : nodes_)
            {
                const Distance distance = Space::distance(Key{}(node), point);
                if (not found or distance < found->second)
                {
                    found.emplace(node, distance);
                }
            }
            return found;
        }

        void nearest(std::vector<Near> &found, const Point &point, std::size_t count, Distance radius) const
        {
            found.clear();
            for (const auto &node : nodes_)
            {
                if (const Distance distance = Space::distance(Key{}(node), point); distance <= radius)
                {
                    found.emplace_back(node, distance);
                }
            }
            std::sort(found.begin(), found.end(), [](const Near &a, const Near &b) { return a.second < b.second; });
            if (found.size() > count)
            {
                found.erase(found.begin() + static_cast<std::ptrdiff_t>(count), found.end());
            }
        }

    private:
        std::vector<Node> nodes_;
    };
}  // namespace unc::robotics::nigh
