!> Rigid contacts in a plane: the convex polygon bounded by half planes n_i.w <= h_i, and the mapping onto it along
!> given directions.
!>
!> A point y outside is mapped to x = y - sum over i of l_i c_i with l_i >= 0, x in the polygon and l_i (h_i - n_i.x)
!> = 0: on an edge, with one load, or at a corner, with two. With directions along the normals x is the nearest point.
!> Redundant half planes are removed: of equal ones the first is retained, of three edges through one corner the outer
!> two.
!>
!> Source: docs/why/theory.md, section 5.3.
module hb_contact_polygon
   use hb_kinds, only: wp
   use hb_text, only: to_text
   implicit none
   private
   public :: contact_polygon_t, landing_t, new_contact_polygon

   real(wp), parameter :: equality_tolerance = 1.0e-12_wp              ! relative; directions and positions that count as equal
   real(wp), parameter :: box_half_width = 1.0e6_wp                    ! side of the box that closes an open polygon, in gaps

   !> A polygon; it is open if its first and last edge do not meet.
   type :: contact_polygon_t
      integer :: n_edges = 0
      integer, allocatable :: contact(:)                              !! half plane of each edge, counterclockwise, (n_edges)
      real(wp), allocatable :: normal(:, :)                           !! n_i, (n_edges, 2)
      real(wp), allocatable :: distance(:)                            !! h_i, (n_edges)
      real(wp), allocatable :: direction(:, :)                        !! c_i, (n_edges, 2)
      logical, allocatable :: is_joined(:)                            !! to the next edge, by a corner, (n_edges)
      real(wp), allocatable :: corner(:, :)                           !! between an edge and the next, (n_edges, 2)
      real(wp), allocatable :: share(:, :, :)                         !! inverse of (c_i, c_next) there, (2, 2, n_edges)
   contains
      procedure :: land => contact_polygon_land
      procedure :: resolve => contact_polygon_resolve
      procedure, private :: next => contact_polygon_next
   end type contact_polygon_t

   !> Loaded edges, their loads, and the derivatives of the loads with respect to the point.
   type :: landing_t
      integer :: n_active = 0                                         !! 0 within the polygon, 1 on an edge, 2 in a corner
      integer :: edge(2) = 0
      real(wp) :: load(2) = 0.0_wp                                    !! l of these edges
      real(wp) :: slope(2, 2) = 0.0_wp                                !! their derivatives by y; first axis: edge
   end type landing_t

contains

   !> Creates the polygon of half planes; `failure` states why there is none.
   pure subroutine new_contact_polygon(self, normals, distances, directions, failure)
      type(contact_polygon_t), intent(out) :: self
      real(wp), intent(in) :: normals(:, :)                           !! n_i, not zero, (n_contacts, 2)
      real(wp), intent(in) :: distances(:)                            !! h_i, (n_contacts)
      real(wp), intent(in) :: directions(:, :)                        !! c_i, as normals
      character(:), allocatable, intent(out) :: failure               !! empty on success
      integer, allocatable :: retained(:)
      real(wp) :: c(2), d(2), determinant
      integer :: i, k, n

      n = size(distances)
      call intersect(normals, distances, retained, failure)
      if (len(failure) > 0) return
      self%contact = pack(retained, retained <= n)                    ! the others are sides of the box
      self%n_edges = size(self%contact)
      self%is_joined = pack(cshift(retained, 1) <= n, retained <= n)
      self%normal = normals(self%contact, :)
      self%distance = distances(self%contact)
      self%direction = directions(self%contact, :)
      allocate (self%corner(self%n_edges, 2), self%share(2, 2, self%n_edges), source=0.0_wp)
      do i = 1, self%n_edges
         k = self%next(i)
         c = self%direction(i, :)
         d = self%direction(k, :)
         if (dot_product(self%normal(i, :), c) <= equality_tolerance*norm2(self%normal(i, :))*norm2(c)) then
            failure = "contact "//to_text(self%contact(i))//" does not open its gap under its own load: the friction is too large"
            return
         end if
         if (.not. self%is_joined(i)) cycle
         self%corner(i, :) = crossing(self%normal(i, :), self%distance(i), self%normal(k, :), self%distance(k))
         determinant = cross(c, d)
         if (determinant <= equality_tolerance*norm2(c)*norm2(d)) then
            failure = "friction exchanges the order of the directions of contacts "//to_text(self%contact(i))//" and "// &
                      to_text(self%contact(k))//", so that their reaction is not unique; "// &
                      "give them friction coefficients that differ less"
            return
         end if
         self%share(1, :, i) = [d(2), -d(1)]/determinant
         self%share(2, :, i) = [-c(2), c(1)]/determinant
      end do
   end subroutine new_contact_polygon

   !> Half planes that bound the intersection, counterclockwise; numbers above size(distances) are sides of a large
   !> box.
   pure subroutine intersect(normals, distances, retained, failure)
      real(wp), intent(in) :: normals(:, :)                           !! (n_contacts, 2)
      real(wp), intent(in) :: distances(:)                            !! (n_contacts)
      integer, allocatable, intent(out) :: retained(:)
      character(:), allocatable, intent(out) :: failure
      real(wp), parameter :: box_normals(4, 2) = reshape([1.0_wp, 0.0_wp, -1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, -1.0_wp], [4, 2])
      real(wp) :: angle(size(distances) + 4), h(size(distances) + 4), n(size(distances) + 4, 2), scale
      logical :: is_side(size(distances) + 4)
      integer :: i, k

      associate (length => norm2(normals, dim=2))
         scale = maxval(abs(distances/length))
         if (scale <= 0.0_wp) scale = 1.0_wp
         n(:size(distances), :) = normals/spread(length, 2, 2)
         n(size(distances) + 1:, :) = box_normals
         h = [distances/length, spread(box_half_width*scale, 1, 4)]
      end associate
      angle = atan2(n(:, 2), n(:, 1))
      where (angle < -acos(-1.0_wp) + equality_tolerance) angle = angle + 2.0_wp*acos(-1.0_wp)
      is_side = [(has_length(n, h, i, equality_tolerance*scale), i=1, size(h))]
      allocate (retained(count(is_side)))
      do k = 1, size(retained)
         retained(k) = minloc(angle, dim=1, mask=is_side)
         is_side(retained(k)) = .false.
      end do
      failure = ""
      if (size(retained) < 3) failure = "the gaps leave no room to move"
   end subroutine intersect

   !> Whether a part of the line of half plane i is inside all others; of equal half planes that of the first.
   pure logical function has_length(n, h, i, least)
      real(wp), intent(in) :: n(:, :), h(:)                           !! normals of length 1, distances
      integer, intent(in) :: i
      real(wp), intent(in) :: least
      real(wp) :: first, last, room, slope
      integer :: k

      has_length = .false.
      first = -huge(1.0_wp)
      last = huge(1.0_wp)
      do k = 1, size(h)                                               ! from h n on, to the left of n
         slope = cross(n(i, :), n(k, :))
         room = h(k) - h(i)*dot_product(n(i, :), n(k, :))
         if (slope > equality_tolerance) then
            last = min(last, room/slope)
         else if (slope < -equality_tolerance) then
            first = max(first, room/slope)
         else if (k /= i .and. (room < -least .or. (room <= least .and. (k < i .or. dot_product(n(i, :), n(k, :)) < 0.0_wp)))) then
            return
         end if
      end do
      has_length = last - first > least
   end function has_length

   !> Maps the point y onto the polygon.
   pure function contact_polygon_land(self, y) result(landing)
      class(contact_polygon_t), intent(in) :: self
      real(wp), intent(in) :: y(2)
      type(landing_t) :: landing
      type(landing_t) :: found
      real(wp) :: beyond(self%n_edges), least, missed
      integer :: i, k, offset

      beyond = self%normal(:, 1)*y(1) + self%normal(:, 2)*y(2) - self%distance
      k = maxloc(beyond, dim=1)
      if (beyond(k) <= 0.0_wp) return
      least = huge(1.0_wp)
      do offset = 0, self%n_edges - 1                                 ! from there to both sides: most points are found at once
         i = 1 + modulo(k - 1 + merge(1, -1, modulo(offset, 2) == 1)*((offset + 1)/2), self%n_edges)
         call land_on_edge(self, i, y, beyond(i), found, missed)
         if (missed < least) landing = found
         least = min(least, missed)
         if (least <= 0.0_wp) return
         if (.not. self%is_joined(i)) cycle
         call land_in_corner(self, i, y, found, missed)
         if (missed < least) landing = found
         least = min(least, missed)
         if (least <= 0.0_wp) return
      end do                                                          ! between two by rounding: the one with the smallest error
   end function contact_polygon_land

   !> Maps onto the line of an edge, and returns the distance beyond an end of the edge; 0 if it is on the edge.
   pure subroutine land_on_edge(self, i, y, beyond, landing, missed)
      class(contact_polygon_t), intent(in) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: y(2), beyond
      type(landing_t), intent(out) :: landing
      real(wp), intent(out) :: missed
      real(wp) :: opening, x(2)
      integer :: before

      missed = huge(1.0_wp)
      if (beyond <= 0.0_wp) return
      opening = dot_product(self%normal(i, :), self%direction(i, :))
      landing%n_active = 1
      landing%edge(1) = i
      landing%load(1) = beyond/opening
      landing%slope(1, :) = self%normal(i, :)/opening
      x = y - landing%load(1)*self%direction(i, :)
      missed = 0.0_wp
      if (self%is_joined(i)) missed = max(missed, past(self%next(i)))
      before = 1 + modulo(i - 2, self%n_edges)
      if (self%is_joined(before)) missed = max(missed, past(before))

   contains

      pure real(wp) function past(k)
         integer, intent(in) :: k

         past = (dot_product(self%normal(k, :), x) - self%distance(k))/norm2(self%normal(k, :))
      end function past
   end subroutine land_on_edge

   !> Maps into the corner after an edge, and returns the largest tensile load that would be needed; not positive if
   !> none is.
   pure subroutine land_in_corner(self, i, y, landing, missed)
      class(contact_polygon_t), intent(in) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: y(2)
      type(landing_t), intent(out) :: landing
      real(wp), intent(out) :: missed

      landing%n_active = 2
      landing%edge = [i, self%next(i)]
      landing%slope = self%share(:, :, i)
      landing%load = matmul(self%share(:, :, i), y - self%corner(i, :))
      missed = max(-landing%load(1)*norm2(self%direction(i, :)), -landing%load(2)*norm2(self%direction(self%next(i), :)))
      landing%load = max(landing%load, 0.0_wp)                        ! tensile loads due to rounding alone
   end subroutine land_in_corner

   !> Resolves a force into loads of the edges; the remainder that no load can balance is tensile.
   pure subroutine contact_polygon_resolve(self, force, landing, pull)
      class(contact_polygon_t), intent(in) :: self
      real(wp), intent(in) :: force(2)
      type(landing_t), intent(out) :: landing
      real(wp), intent(out) :: pull                                   !! magnitude, as force
      real(wp) :: load, loads(2), remains
      integer :: i

      pull = norm2(force)
      do i = 1, self%n_edges
         if (self%is_joined(i)) then
            loads = matmul(self%share(:, :, i), force)
            if (all(loads >= 0.0_wp)) then
               landing = landing_t(n_active=2, edge=[i, self%next(i)], load=loads, slope=self%share(:, :, i))
               pull = 0.0_wp
               return
            end if
         end if
         load = max(dot_product(force, self%direction(i, :))/sum(self%direction(i, :)**2), 0.0_wp)
         remains = norm2(force - load*self%direction(i, :))
         if (remains >= pull) cycle
         pull = remains
         landing = landing_t(n_active=1, edge=[i, 0], load=[load, 0.0_wp])
      end do
   end subroutine contact_polygon_resolve

   !> The edge after edge i.
   pure integer function contact_polygon_next(self, i)
      class(contact_polygon_t), intent(in) :: self
      integer, intent(in) :: i

      contact_polygon_next = 1 + modulo(i, self%n_edges)
   end function contact_polygon_next

   !> Point with a.x = h and b.x = g, for directions that are not parallel.
   pure function crossing(a, h, b, g) result(x)
      real(wp), intent(in) :: a(2), h, b(2), g
      real(wp) :: x(2)

      x = [h*b(2) - g*a(2), g*a(1) - h*b(1)]/cross(a, b)
   end function crossing

   pure real(wp) function cross(a, b)
      real(wp), intent(in) :: a(2), b(2)

      cross = a(1)*b(2) - a(2)*b(1)
   end function cross
end module hb_contact_polygon
