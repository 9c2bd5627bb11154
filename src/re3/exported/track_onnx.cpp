// Track an object with a network that `re3 export` wrote: boxes as left,top,width,height a line.
// Frames come as raw BGR:
//   ffmpeg -i clip.mp4 -f rawvideo -pix_fmt bgr24 - | ./track_onnx model.onnx WIDTH HEIGHT X Y W H
// Build, with ONNX Runtime's headers and library:
//   g++ -std=c++17 -O2 track_onnx.cpp -I ORT/include -L ORT/lib -lonnxruntime -o track_onnx
#include <onnxruntime_cxx_api.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <string>
#include <vector>

using Box = std::array<double, 4>;  // left, top, width, height
using State = std::map<std::string, std::vector<float>>;
struct Frame { int width, height; std::vector<uint8_t> bgr; };
struct View { double context; int size; };
struct Spec {
  View previous, current;
  double fill, scale;
  int reset;
  std::string kept;
  bool look, whole;
};

// A number of the description that the file carries, after one key and another one after it.
double number(const std::string& json, const char* key, const char* inner = "") {
  size_t at = json.find(inner, json.find("\"" + std::string(key) + "\""));
  if (!*inner) at = json.find(':', at);
  return std::atof(json.c_str() + json.find_first_of("0123456789", at));
}

Box region(const Box& box, View view, bool whole) {
  double w = std::max(box[2], 1.0) * view.context, h = std::max(box[3], 1.0) * view.context;
  if (whole) return {box[0] + box[2] / 2 - w / 2, box[1] + box[3] / 2 - h / 2, w, h};
  // On a grid of powers of two rounding errors do not grow from frame to frame.
  double grid = std::exp2(std::floor(std::log2(std::min(w, h) / 256)));
  auto snap = [&](double value) { return std::nearbyint(value / grid) * grid; };
  double x = box[0] + box[2] / 2, y = box[1] + box[3] / 2;
  double left = snap(x - w / 2), top = snap(y - h / 2);
  return {left, top, snap(x + w / 2) - left, snap(y + h / 2) - top};
}

// What some pixels of a side count for each value of the crop's side: linear interpolation, wider
// where the crop is the coarser of the two.
struct Tap { int pixel; double share; };
std::vector<std::vector<Tap>> weights(double low, double extent, int size, int pixels) {
  std::vector<std::vector<Tap>> table(size);
  double reach = std::max(1.0, extent / size);
  for (int i = 0; i < size; ++i) {
    double centre = low + (i + 0.5) * extent / size, sum = 0;
    for (int x = (int)std::floor(centre - reach); x <= std::floor(centre + reach) + 1; ++x) {
      double share = std::max(1 - std::abs(x + 0.5 - centre) / reach, 0.0);
      sum += share;
      if (x >= 0 && x < pixels && share > 0) table[i].push_back({x, share});
    }
    for (auto& tap : table[i]) tap.share /= sum;
  }
  return table;
}

// The same of a side rounded to whole pixels: what is inside is resized, the rest left out.
std::vector<std::vector<Tap>> whole_pixel_weights(double left, double extent, int size, int pixels) {
  std::vector<std::vector<Tap>> table(size);
  long low = std::lrint(left), high = std::lrint(left + extent);
  long start = std::clamp(low, 0L, (long)pixels), stop = std::clamp(high, 0L, (long)pixels);
  if (start >= stop) return table;
  long count = std::max(std::lrint(double(size) * (stop - start) / (high - low)), 1L);
  long first = std::max(-low, 0L) * size / (high - low);
  for (long i = 0; i < count; ++i) {
    double place = start + (i + 0.5) * (stop - start) / count - 0.5;
    long near = (long)std::floor(place);
    table[first + i].push_back({(int)std::clamp(near, start, stop - 1), 1 - (place - near)});
    table[first + i].push_back({(int)std::clamp(near + 1, start, stop - 1), place - near});
  }
  return table;
}

// [S, S, 3]; what lies outside the frame has the colour `fill`.
std::vector<uint8_t> crop(const Frame& frame, const Box& box, View view, const Spec& spec) {
  Box r = region(box, view, spec.whole);
  double fill = spec.fill;
  auto table = spec.whole ? whole_pixel_weights : weights;
  auto down = table(r[1], r[3], view.size, frame.height);
  auto across = table(r[0], r[2], view.size, frame.width);
  size_t line = size_t(frame.width) * 3;
  std::vector<double> row(line);
  std::vector<uint8_t> out;
  for (auto& taps : down) {
    std::fill(row.begin(), row.end(), 0.0);
    for (auto& tap : taps)
      for (size_t i = 0; i < line; ++i)
        row[i] += tap.share * (frame.bgr[tap.pixel * line + i] - fill);
    for (auto& cell : across)
      for (int c = 0; c < 3; ++c) {
        double sum = fill;
        for (auto& tap : cell) sum += tap.share * row[tap.pixel * 3 + c];
        // Half way between two values, rounding errors are not to decide.
        out.push_back((uint8_t)std::floor(sum + 0.500001));
      }
  }
  return out;
}

// One step of the network: the box found; the state goes on to the new one.
Box step(Ort::Session& net, const Spec& spec, const Frame& frame, const Frame& previous,
         const Box& box, State& state) {
  Ort::AllocatorWithDefaultOptions allocator;
  auto memory = Ort::MemoryInfo::CreateCpu(OrtArenaAllocator, OrtMemTypeDefault);
  auto now = crop(frame, box, spec.current, spec), before = now;
  if (spec.previous.size) before = crop(previous, box, spec.previous, spec);
  std::vector<std::string> in, out{"corners", "score"};
  std::vector<Ort::Value> values;
  for (size_t i = 0; i < net.GetInputCount(); ++i) {
    in.push_back(net.GetInputNameAllocated(i, allocator).get());
    auto shape = net.GetInputTypeInfo(i).GetTensorTypeAndShapeInfo().GetShape();
    shape[0] = 1;
    if (in[i].find("_crops") != std::string::npos) {
      auto& bytes = in[i] == "current_crops" ? now : before;
      values.push_back(Ort::Value::CreateTensor<uint8_t>(memory, bytes.data(), bytes.size(),
                                                         shape.data(), shape.size()));
    } else {
      auto& floats = state[in[i]];
      size_t count = 1;
      for (auto side : shape) count *= side;
      floats.resize(count);  // zeros before the first step
      values.push_back(Ort::Value::CreateTensor<float>(memory, floats.data(), count, shape.data(),
                                                       shape.size()));
      out.push_back("new_" + in[i]);
    }
  }
  std::vector<const char*> in_names, out_names;
  for (auto& name : in) in_names.push_back(name.c_str());
  for (auto& name : out) out_names.push_back(name.c_str());
  auto found = net.Run({}, in_names.data(), values.data(), in.size(), out_names.data(), out.size());
  State after;
  for (size_t i = 2; i < out.size(); ++i) {
    const float* data = found[i].GetTensorData<float>();
    size_t count = found[i].GetTensorTypeAndShapeInfo().GetElementCount();
    after[out[i].substr(4)].assign(data, data + count);
  }
  state = after;
  const float* c = found[0].GetTensorData<float>();
  Box r = region(box, spec.current, spec.whole);
  double across = r[2] / spec.scale, down = r[3] / spec.scale;  // a unit of the corners in pixels
  double w = std::max((c[2] - c[0]) * across, 1.0), h = std::max((c[3] - c[1]) * down, 1.0);
  double x = std::clamp(r[0] + (c[0] + c[2]) / 2 * across, 0.0, (double)frame.width);
  double y = std::clamp(r[1] + (c[1] + c[3]) / 2 * down, 0.0, (double)frame.height);
  return {x - w / 2, y - h / 2, w, h};
}

int main(int argc, char** argv) {
  if (argc != 8) {
    std::fprintf(stderr, "usage: %s model.onnx WIDTH HEIGHT X Y W H\n", argv[0]);
    return 2;
  }
  Ort::Env env(ORT_LOGGING_LEVEL_ERROR);
  Ort::Session net(env, argv[1], Ort::SessionOptions());
  Ort::AllocatorWithDefaultOptions allocator;
  auto told = net.GetModelMetadata().LookupCustomMetadataMapAllocated("re3_spec", allocator);
  std::string json = told.get(), kept = json.substr(json.find("\"kept_at_reset\""));
  auto is = [&](const char* text) { return json.find(text) != std::string::npos; };
  Spec spec{{0, 0},
            {number(json, "current", "context"), (int)number(json, "current", "size")},
            number(json, "fill"),
            number(json, "regression_scale"),
            (int)number(json, "reset_interval"),
            kept.substr(0, kept.find(']')),
            is("\"look_at_reset\": true"),
            is("\"whole_pixels\": true")};
  if (json.find("\"previous\": null") == std::string::npos)
    spec.previous = {number(json, "previous", "context"), (int)number(json, "previous", "size")};
  Frame frame{std::atoi(argv[2]), std::atoi(argv[3]), {}}, previous;
  frame.bgr.resize(size_t(frame.width) * frame.height * 3);
  Box box{std::atof(argv[4]), std::atof(argv[5]), std::atof(argv[6]), std::atof(argv[7])};
  State state, first;
  for (int steps = 0; std::fread(frame.bgr.data(), 1, frame.bgr.size(), stdin) == frame.bgr.size();) {
    if (previous.bgr.empty()) {  // the first pass: what it finds is discarded for the box given
      step(net, spec, frame, frame, box, state);
      first = state;
    } else {
      box = step(net, spec, frame, previous, box, state);
      if (++steps == spec.reset) {
        steps = 0;
        for (auto& [name, values] : first)
          if (spec.kept.find('"' + name + '"') == std::string::npos) state[name] = values;
        if (spec.look) step(net, spec, frame, frame, box, state);
      }
    }
    previous = frame;
    std::printf("%.3f,%.3f,%.3f,%.3f\n", box[0], box[1], box[2], box[3]);
    std::fflush(stdout);
  }
}
