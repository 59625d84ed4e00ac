// Which robots of the floor a frame of the timeline is about: rings around them, while the pointer is at the frame.

import { radius_px } from "../bodies.js";

const RING_PX = 9;

/** The rings on a floor. */
export class Lights {
  /** @param {import("../floor.js").Floor} floor */
  constructor(floor) {
    this.floor = floor;
    this.robots = [];
    floor.extras.push((pen) => this.paint(pen));
  }

  /** Show rings around these robots only. */
  show(robots) {
    if (!robots.length && !this.robots.length) return;
    this.robots = robots;
    this.floor.draw();
  }

  paint(pen) {
    const { floor } = this;
    const places = this.robots.map((robot) => floor.run.places[robot]).filter(Boolean).map((at) => floor.place(at));
    pen.globalAlpha = 1;
    pen.strokeStyle = floor.colours.accent;
    pen.lineWidth = 3;
    places.forEach(([x, y], number) => {
      pen.beginPath();
      pen.arc(x, y, radius_px(floor, this.robots[number]) + RING_PX, 0, 2 * Math.PI);
      pen.stroke();
    });
    pen.lineWidth = 1.5;
    for (const place of places.slice(1)) floor.line(pen, places[0], place);
  }
}
