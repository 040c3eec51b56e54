// A DDS peer on Fast DDS for the tests of cobot/dds/rtps. Usage: peer DOMAIN; it obeys one command a line:
//
//   writer ID TOPIC TYPE RELIABLE LATCHED DEPTH      DEPTH 0 keeps all; the others are 0 or 1
//   reader ID TOPIC TYPE RELIABLE LATCHED DEPTH
//   wait ID                                          until the endpoint is matched: "matched ID"
//   write ID COUNT SIZE PERIOD_US                    then "wrote ID"
//   client ID SERVICE TYPE                           writer and reader as rmw_fastrtps makes them
//   call ID COUNT                                    one after the other: "called ID REPLIES MISMATCHED"
//   report ID                                        "report ID {json}" of what a reader has got
//   delete ID                                        then "deleted ID"
//   quit                                             delete the participant first; end of input does not
//
// A payload is 4 bytes of encapsulation, a uint32 number from 1 on, a double of seconds on the monotonic clock, then
// bytes (number + index) & 0xFF.
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/common/WriteParams.h>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <sstream>
#include <thread>
#include <vector>

namespace fast = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;
using Bytes = std::vector<unsigned char>;
constexpr size_t HEAD = 16;

double now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// Bytes that are serialised already.
class Serialised : public fast::TopicDataType {
public:
    explicit Serialised(const std::string& name) {
        setName(name.c_str());
        m_typeSize = 1024;
        m_isGetKeyDefined = false;
        auto_fill_type_object(false);
        auto_fill_type_information(false);
    }
    bool serialize(void* data, rtps::SerializedPayload_t* payload) override {
        auto& bytes = *static_cast<Bytes*>(data);
        if (bytes.size() > payload->max_size) return false;
        std::copy(bytes.begin(), bytes.end(), payload->data);
        payload->length = bytes.size();
        payload->encapsulation = CDR_LE;
        return true;
    }
    bool deserialize(rtps::SerializedPayload_t* payload, void* data) override {
        static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
        return [data] { return static_cast<uint32_t>(static_cast<Bytes*>(data)->size()); };
    }
    void* createData() override { return new Bytes; }
    void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
    bool getKey(void*, rtps::InstanceHandle_t*, bool) override { return false; }
};

Bytes numbered(uint32_t number, size_t size) {
    Bytes bytes(std::max(size, HEAD));
    bytes[1] = 1;
    std::memcpy(&bytes[4], &number, 4);
    double time = now();
    std::memcpy(&bytes[8], &time, 8);
    for (size_t i = HEAD; i < bytes.size(); ++i) bytes[i] = static_cast<unsigned char>(number + i);
    return bytes;
}

// Counts what comes, and checks it.
class Counter : public fast::DataReaderListener {
public:
    void on_data_available(fast::DataReader* reader) override {
        Bytes bytes;
        fast::SampleInfo info;
        while (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK)
            if (info.valid_data) add(bytes);
    }
    std::string report() {
        std::lock_guard<std::mutex> lock(mutex_);
        std::sort(delays_.begin(), delays_.end());
        auto at = [&](double share) { return delays_.empty() ? -1 : delays_[size_t(share * (delays_.size() - 1))]; };
        std::ostringstream text;
        text << "{\"count\": " << delays_.size() << ", \"wrong\": " << wrong_ << ", \"unordered\": " << unordered_
             << ", \"first\": " << first_ << ", \"last\": " << last_ << ", \"largest\": " << largest_
             << ", \"p50_s\": " << at(0.5) << ", \"p99_s\": " << at(0.99) << ", \"max_s\": " << at(1) << "}";
        return text.str();
    }

private:
    void add(const Bytes& bytes) {
        double arrived = now(), sent = 0;
        uint32_t number = 0;
        std::lock_guard<std::mutex> lock(mutex_);
        if (bytes.size() < HEAD) {
            ++wrong_;
            return;
        }
        std::memcpy(&number, &bytes[4], 4);
        std::memcpy(&sent, &bytes[8], 8);
        for (size_t i = HEAD; i < bytes.size(); ++i)
            if (bytes[i] != static_cast<unsigned char>(number + i)) {
                ++wrong_;
                break;
            }
        unordered_ += number <= last_;
        if (!first_) first_ = number;
        last_ = number;
        largest_ = std::max(largest_, bytes.size());
        delays_.push_back(arrived - sent);
    }
    std::mutex mutex_;
    std::vector<double> delays_;
    uint32_t first_ = 0, last_ = 0;
    size_t wrong_ = 0, unordered_ = 0, largest_ = 0;
};

struct Endpoint {
    fast::DataWriter* writer = nullptr;
    fast::DataReader* reader = nullptr;
    std::unique_ptr<Counter> counter;
    uint32_t number = 0;
};

class Peer {
public:
    explicit Peer(uint32_t domain) {
        fast::DomainParticipantQos qos = fast::PARTICIPANT_QOS_DEFAULT;
        std::string enclave = "enclave=/;";
        qos.user_data().assign(enclave.begin(), enclave.end());
        qos.name("peer");
        auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
        const char* localhost_only = std::getenv("ROS_LOCALHOST_ONLY");
        if (localhost_only == nullptr || std::string(localhost_only) != "0")
            udp->interfaceWhiteList.push_back("127.0.0.1");
        qos.transport().use_builtin_transports = false;
        qos.transport().user_transports.push_back(udp);
        participant_ = fast::DomainParticipantFactory::get_instance()->create_participant(domain, qos);
        publisher_ = participant_->create_publisher(fast::PUBLISHER_QOS_DEFAULT);
        subscriber_ = participant_->create_subscriber(fast::SUBSCRIBER_QOS_DEFAULT);
    }

    bool obey(const std::string& line) {
        std::istringstream words(line);
        std::string verb, id;
        words >> verb >> id;
        if (verb == "quit") return leave();
        Endpoint& end = ends_[id];
        if (verb == "writer" || verb == "reader") open(end, verb == "writer", words);
        if (verb == "wait") wait(id, end);
        if (verb == "write") write(id, end, words);
        if (verb == "client") client(end, words);
        if (verb == "call") call(id, end, words);
        if (verb == "report") std::cout << "report " << id << " " << end.counter->report() << std::endl;
        if (verb == "delete") remove(id, end);
        return true;
    }

private:
    fast::Topic* topic(const std::string& name, const std::string& type) {
        auto known = topics_.find(name);
        if (known != topics_.end()) return known->second;
        fast::TypeSupport support(new Serialised(type));
        support.register_type(participant_);
        return topics_[name] = participant_->create_topic(name, type, fast::TOPIC_QOS_DEFAULT);
    }

    template <class Qos>
    Qos endpoint_qos(Qos qos, bool reliable, bool latched, int depth) {
        qos.reliability().kind = reliable ? fast::RELIABLE_RELIABILITY_QOS : fast::BEST_EFFORT_RELIABILITY_QOS;
        qos.durability().kind = latched ? fast::TRANSIENT_LOCAL_DURABILITY_QOS : fast::VOLATILE_DURABILITY_QOS;
        qos.history().kind = depth ? fast::KEEP_LAST_HISTORY_QOS : fast::KEEP_ALL_HISTORY_QOS;
        if (depth) qos.history().depth = depth;
        qos.endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
        qos.data_sharing().off();
        return qos;
    }

    void make(Endpoint& end, bool writer, const std::string& name, const std::string& type, bool reliable,
              bool latched, int depth, bool count) {
        if (writer) {
            auto qos = endpoint_qos(fast::DATAWRITER_QOS_DEFAULT, reliable, latched, depth);
            // The default of 3 s would make every test with losses wait for it.
            qos.reliable_writer_qos().times.heartbeatPeriod = {0, 100000000};
            // Samples above 64 kB go out only from a thread of their own; rmw_fastrtps has none by default.
            if (!depth) qos.publish_mode().kind = fast::ASYNCHRONOUS_PUBLISH_MODE;
            end.writer = publisher_->create_datawriter(topic(name, type), qos);
            return;
        }
        auto qos = endpoint_qos(fast::DATAREADER_QOS_DEFAULT, reliable, latched, depth);
        if (count) end.counter.reset(new Counter);
        end.reader = subscriber_->create_datareader(topic(name, type), qos, end.counter.get());
    }

    void open(Endpoint& end, bool writer, std::istringstream& words) {
        std::string name, type;
        int reliable, latched, depth;
        words >> name >> type >> reliable >> latched >> depth;
        make(end, writer, name, type, reliable, latched, depth, true);
    }

    bool matched(Endpoint& end) {
        fast::PublicationMatchedStatus publication;
        fast::SubscriptionMatchedStatus subscription;
        if (end.writer) end.writer->get_publication_matched_status(publication);
        if (end.reader) end.reader->get_subscription_matched_status(subscription);
        return (!end.writer || publication.current_count > 0) && (!end.reader || subscription.current_count > 0);
    }

    void wait(const std::string& id, Endpoint& end) {
        while (!matched(end)) std::this_thread::sleep_for(std::chrono::milliseconds(2));
        std::cout << "matched " << id << std::endl;
    }

    void write(const std::string& id, Endpoint& end, std::istringstream& words) {
        int count, period;
        size_t size;
        words >> count >> size >> period;
        auto due = std::chrono::steady_clock::now();
        for (int i = 0; i < count; ++i) {
            Bytes bytes = numbered(++end.number, size);
            end.writer->write(&bytes);
            due += std::chrono::microseconds(period);
            std::this_thread::sleep_until(due);
        }
        std::cout << "wrote " << id << std::endl;
    }

    void client(Endpoint& end, std::istringstream& words) {
        std::string service, type;
        words >> service >> type;
        make(end, true, "rq" + service + "Request", type + "_Request_", true, false, 10, false);
        make(end, false, "rr" + service + "Reply", type + "_Response_", true, false, 10, false);
    }

    // Replies carry the request's number; what belongs to another request is a mismatch.
    void call(const std::string& id, Endpoint& end, std::istringstream& words) {
        int count, replies = 0, mismatched = 0;
        words >> count;
        for (int i = 0; i < count; ++i) {
            Bytes request = numbered(++end.number, HEAD), reply;
            rtps::WriteParams parameters;
            parameters.related_sample_identity().writer_guid() = end.reader->guid();
            end.writer->write(&request, parameters);
            auto asked = parameters.sample_identity().sequence_number();
            double until = now() + 10;
            for (bool got = false; !got && now() < until;) {
                if (!end.reader->wait_for_unread_message({0, 100000000})) continue;
                fast::SampleInfo info;
                if (end.reader->take_next_sample(&reply, &info) != ReturnCode_t::RETCODE_OK || !info.valid_data)
                    continue;
                auto& related = info.related_sample_identity;
                bool ours = related.writer_guid() == end.reader->guid() || related.writer_guid() == end.writer->guid();
                got = ours && related.sequence_number() == asked && reply == request;
                replies += got;
                mismatched += !got;
            }
        }
        std::cout << "called " << id << " " << replies << " " << mismatched << std::endl;
    }

    void remove(const std::string& id, Endpoint& end) {
        if (end.writer) publisher_->delete_datawriter(end.writer);
        if (end.reader) subscriber_->delete_datareader(end.reader);
        ends_.erase(id);
        std::cout << "deleted " << id << std::endl;
    }

    bool leave() {
        participant_->delete_contained_entities();
        fast::DomainParticipantFactory::get_instance()->delete_participant(participant_);
        std::cout << "left" << std::endl;
        return false;
    }

    fast::DomainParticipant* participant_;
    fast::Publisher* publisher_;
    fast::Subscriber* subscriber_;
    std::map<std::string, fast::Topic*> topics_;
    std::map<std::string, Endpoint> ends_;
};

int main(int, char** arguments) {
    auto* peer = new Peer(std::stoul(arguments[1]));
    std::string line;
    std::cout << "ready" << std::endl;
    while (std::getline(std::cin, line))
        if (!peer->obey(line)) break;
    std::_Exit(0);  // without a word to the others, unless it was told to quit
}
