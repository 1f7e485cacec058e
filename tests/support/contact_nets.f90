!> A net with many contacts, for tests of whole models.
module contact_nets
   use hb_coordinates, only: coordinate_part_t, coordinates_t, new_coordinates
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_proportional_damping, only: proportional_damping_t
   use hb_sparse, only: sparse_from_entries, sparse_t
   use hb_structure, only: new_structure, structure_t
   use hb_text, only: to_text
   implicit none
   private
   public :: make_net, n, n_contacts

   integer, parameter :: n_side = 33, n = n_side**2, n_contacts = 105

contains

   !> A square net of masses, loosely held, damped in proportion but for one damper, with contacts between neighbours.
   subroutine make_net(net, coordinates, damper)
      type(structure_t), intent(out) :: net
      type(coordinates_t), intent(out) :: coordinates
      real(wp), intent(in) :: damper                                  !! [N s/m]
      type(sparse_t) :: mass, stiffness, damping
      type(proportional_damping_t) :: proportional
      type(error_t), allocatable :: error
      type(coordinate_part_t) :: parts(n_contacts)
      integer, allocatable :: column(:), row(:)
      real(wp), allocatable :: value(:)
      character(16) :: labels(n)
      character(8) :: units(n)
      integer :: i, k, step

      allocate (row(0), column(0), value(0))
      do k = 1, n
         labels(k) = "x"//to_text(k)
         row = [row, k]
         column = [column, k]
         value = [value, 1.0e-3_wp]
         do step = 1, n_side, n_side - 1                              ! to the right, and to the next row
            if (k + step > n .or. (step == 1 .and. mod(k, n_side) == 0)) cycle
            row = [row, k, k + step, k, k + step]
            column = [column, k, k + step, k + step, k]
            value = [value, 1.0_wp, 1.0_wp, -1.0_wp, -1.0_wp]
         end do
      end do
      units = "m"
      stiffness = sparse_from_entries(n, row, column, value)
      mass = sparse_from_entries(n, [(i, i=1, n)], [(i, i=1, n)], [(1.0_wp + 0.1_wp*mod(i, 7), i=1, n)])
      proportional%mass = 0.02_wp
      proportional%stiffness = 0.5_wp
      damping = proportional%matrix(mass, stiffness)
      damping%value(1) = damping%value(1) + damper
      call new_structure(net, mass, damping, stiffness, labels, units, error)
      if (allocated(error)) error stop "contact_nets: the net is no structure"
      do i = 1, n_contacts
         parts(i) = coordinate_part_t([2*i - 1, 2*i], reshape([1.0_wp, -0.5_wp], [2, 1]))
      end do
      call new_coordinates(coordinates, net, [(4*i, 4*i + 1, i=1, n_contacts)], parts)
   end subroutine make_net
end module contact_nets
